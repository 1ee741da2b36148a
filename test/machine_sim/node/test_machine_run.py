"""Machines in a run: stepping, and publications that are due."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from support.machine_runs import RUN_ID, MakeRun, Soil, machine_runs

from machine_sim.machine.errors import MachineError
from msg_bridge.contract.errors import ParameterError


@pytest.fixture
def make() -> Iterator[MakeRun]:
    with machine_runs() as make:
        yield make


def test_machine_takes_tick_period_and_soils_from_the_run(make: MakeRun) -> None:
    run = make(tick=0.02, machine_id=6, x=3.0, y=-2.0, yaw=90.0)
    assert run.sim.params.steps_per_tick == 4
    assert run.sim.particles.soils == run.facts.soils
    assert (run.endpoint.exchange.run_id, run.endpoint.exchange.machine_id) == (RUN_ID, 6)
    position, quaternion = run.sim.machine.base_pose
    assert position[:2] == pytest.approx([3.0, -2.0])
    assert quaternion == pytest.approx([0, 0, math.sqrt(0.5), math.sqrt(0.5)])


def test_tick_period_that_is_no_multiple_of_the_step_is_rejected(make: MakeRun) -> None:
    with pytest.raises(ParameterError, match="physics_step"):
        make(tick=0.012)
    with pytest.raises(ParameterError, match="physics_step"):
        make(tick=0.001)
    with pytest.raises(ParameterError, match="40 physics steps"):
        make(tick=0.2)


def test_position_off_the_map_is_rejected(make: MakeRun) -> None:
    with pytest.raises(MachineError):
        make(x=500.0)


def test_machine_steps_as_soon_as_it_is_answered(make: MakeRun) -> None:
    run = make()
    assert not run.can_step
    soil = Soil(run)
    for _ in range(2):  # one ahead of the soil's answers
        assert run.can_step
        run.step()
    assert not run.can_step
    soil.answer()
    assert run.can_step


def test_terrain_is_needed_to_join_and_of_another_run(make: MakeRun) -> None:
    run = make()
    assert run.needs_map(RUN_ID)
    Soil(run)
    assert not run.needs_map(RUN_ID)
    assert run.needs_map(RUN_ID + 1)


@pytest.mark.parametrize(
    ("rate", "ticks"),
    [(100.0, [1, 2, 3, 4]), (50.0, [2, 4]), (1000.0, [1, 2, 3, 4]), (25.0, [4]), (0.0, [])],
)
def test_publication_is_due_at_its_rate_in_simulation_time(
    make: MakeRun, rate: float, ticks: list[int]
) -> None:
    run = make()
    assert [tick for tick in range(1, 5) if run.is_due(tick, rate)] == ticks


def test_skipped_ticks_are_counted_and_what_was_due_in_them_is_published_next(
    make: MakeRun,
) -> None:
    run, made = make(), []
    soil = Soil(run)
    run.step()
    for _ in range(12):  # a machine that makes one tick of four
        made.append((run.tick, run.is_due(run.tick, 20.0)))
        run.step()
        soil.answer(ticks_before=3)
    assert run.progress.made == 13
    assert run.progress.passed == run.tick
    assert run.progress.passed == pytest.approx(4 * run.progress.made, rel=0.2)
    ticks, due = zip(*made, strict=True)
    intervals = zip((0, *ticks), ticks, strict=False)
    assert list(due) == [before // 5 != now // 5 for before, now in intervals]
