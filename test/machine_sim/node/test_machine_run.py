"""Machines in a run: stepping, waiting for commands, publications that are due."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from support.machine_scenes import GRID, excavator

from machine_sim.commands import AppliedCommand, CommandArbiter
from machine_sim.dem import ParticleParams
from machine_sim.machine.errors import MachineError
from machine_sim.node.command_scheduler import CommandScheduler
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.machine_run import MachineRun
from machine_sim.node.params import MachineInstanceParams, MachineNodeParams
from machine_sim.params import MachineSimParams
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import CONVERSION, FORCE, MAP_UPDATE, empty_rows
from msg_bridge.exchange.soil_exchange import SoilExchange
from msg_bridge.exchange.welcome import Welcome

RUN_ID = 4
KEYFRAME = Keyframe(RUN_ID, 0, GRID, np.zeros(GRID.shape))

MakeRun = Callable[..., MachineRun]


@pytest.fixture
def make() -> Iterator[MakeRun]:
    made: list[MachineRun] = []

    def run(
        *others: MachineInstanceParams,
        tick: float = 0.01,
        realtime: bool = False,
        physics_step: float = 0.005,
        **params: Any,
    ) -> MachineRun:
        machine, of_node = excavator(), MachineNodeParams(**params)
        made.append(
            MachineRun(
                [
                    MachineInstance(each, machine, CommandArbiter(machine))
                    for each in (of_node, *others)
                ],
                of_node,
                MachineSimParams(physics_step=physics_step),
                ParticleParams(),
                RunFacts(RUN_ID, tick, realtime, GRID.cell, (LooseSoil(0.25, 1700.0),)),
                KEYFRAME,
                session_id=5,
            )
        )
        return made[-1]

    yield run
    for each in made:
        each.close()


def valid_command(effect_time: float | None) -> bool:
    """Apply a command that the arbiter accepts."""
    return True


class Soil:
    """Soil exchange that answers the ticks of a run without any change."""

    def __init__(self, run: MachineRun) -> None:
        self.run = run
        self.exchange = SoilExchange(Welcome(GRID, lambda: np.zeros(GRID.shape)), run_id=RUN_ID)
        run.endpoint.join()
        self.answer()

    def answer(self, *, ticks_before: int = 0) -> None:
        """Answer the tick that was sent, after some ticks without the machine."""
        nothing = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(MAP_UPDATE))
        for _ in range(ticks_before):
            assert self.exchange.poll(wait=False) is not None
            self.exchange.answer(*nothing, revision=0, terrain_mm3=0)
        for message in self.run.endpoint.drain_outbox():
            self.exchange.receive(message)
        assert self.exchange.poll() is not None
        self.exchange.answer(*nothing, revision=0, terrain_mm3=0)
        for message in self.exchange.drain_outbox():
            self.run.endpoint.receive(message)
        self.run.endpoint.poll()

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.tick()

    def tick(self) -> list[AppliedCommand]:
        """Perform a tick, and return the commands that took effect."""
        commands = self.run.apply_commands(0.0)
        self.run.step()
        self.answer()
        return commands


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


def test_commands_time_out_by_simulation_time_in_lockstep_and_by_wall_time_in_real_time(
    make: MakeRun,
) -> None:
    for realtime in (False, True):
        run = make(realtime=realtime)
        soil, (scheduler,) = Soil(run), run.schedulers
        timeout = scheduler.arbiter.params.command_timeout
        run.apply_commands(70.0)
        scheduler.arbiter.receive_front([0.3, 0.0, 0.0, 0.0], scheduler.command_time(70.0))
        ticks = round(1.5 * timeout / 0.01)
        speeds = []
        for tick in range(ticks):  # the wall clock runs twice as fast as simulation time
            (applied,) = run.apply_commands(70.0 + 0.005 * tick)
            speeds.append(applied.joints[0])
            run.step()
            soil.answer()
        assert speeds[0] == 0.3
        assert (speeds[-1] == 0.0) is not realtime


def test_command_applies_in_the_tick_that_begins_now(make: MakeRun) -> None:
    run = make()
    soil = Soil(run)
    run.schedulers[0].arbiter.receive_front(
        [0.3, 0.0, 0.0, 0.0], run.schedulers[0].command_time(0.0)
    )
    (applied,) = run.apply_commands(0.0)
    assert applied.joints.tolist() == [0.3, 0.0, 0.0, 0.0]
    before = run.sim.machine.joint_positions[0]
    run.step()
    soil.answer()
    soil.ticks(60)
    assert run.sim.machine.joint_positions[0] > before + 0.02


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


def test_waiting_machine_steps_once_the_command_has_arrived(
    make: MakeRun,
) -> None:
    run = make(command_wait_period=1)
    soil = Soil(run)
    assert not run.can_step
    run.schedulers[0].receive(0.0, valid_command)
    assert run.can_step
    soil.ticks(1)
    assert not run.can_step
    run.schedulers[0].receive(0.0, valid_command)
    assert not run.can_step
    run.schedulers[0].receive(0.01, valid_command)
    assert run.can_step


def test_each_machine_of_a_node_has_its_own_wait_period(make: MakeRun) -> None:
    run = make(
        MachineInstanceParams(y=9.0),
        MachineInstanceParams(y=-9.0, command_wait_period=1),
        command_wait_period=1,
    )
    Soil(run)
    run.schedulers[0].receive(0.0, valid_command)
    assert not run.can_step
    run.schedulers[2].receive(0.0, valid_command)
    assert run.can_step


def test_each_machine_of_a_node_has_its_own_commands(make: MakeRun) -> None:
    run = make(MachineInstanceParams(y=9.0))
    Soil(run)
    run.schedulers[1].arbiter.receive_front([0.0, 0.1, 0.0, 0.0], 0.0)
    first, second = run.apply_commands(0.0)
    assert (first.joints.tolist(), second.joints.tolist()) == ([0.0] * 4, [0.0, 0.1, 0.0, 0.0])


def test_machine_waits_once_per_wait_period(make: MakeRun) -> None:
    run = make(command_wait_period=3)
    soil, waited = Soil(run), []
    for tick in range(7):
        if not run.can_step:
            waited.append(tick)
        run.schedulers[0].receive(run.schedulers[0].sim_time, valid_command)
        soil.ticks(1)
    assert waited == [0, 3, 6]


def test_early_command_is_not_awaited_again(make: MakeRun) -> None:
    run = make(command_wait_period=1)
    soil = Soil(run)
    run.schedulers[0].receive(0.02, valid_command)
    for _ in range(3):
        assert run.can_step
        soil.ticks(1)
    assert not run.can_step


def test_command_takes_effect_command_delay_ticks_after_its_stamp(
    make: MakeRun,
) -> None:
    run = make(command_wait_period=2, command_delay=2)
    soil, boom = Soil(run), 1

    def send(stamp: float, velocity: float) -> None:
        def deliver(effect_time: float | None) -> bool:
            run.schedulers[0].arbiter.receive_joints(
                ["boom"], [velocity], [], run.schedulers[0].sim_time, effect_time=effect_time
            )
            return True

        run.schedulers[0].receive(stamp, deliver)

    def applied() -> float:
        return float(soil.tick()[0].joints[boom])

    send(0.0, 0.1)
    before = [applied(), applied()]
    send(0.02, 0.2)
    assert before + [applied() for _ in range(4)] == [0.0, 0.0, 0.1, 0.1, 0.2, 0.2]


def test_machine_continues_for_the_delay_while_a_command_is_awaited(make: MakeRun) -> None:
    run = make(command_wait_period=2, command_delay=2)
    soil, waited = Soil(run), []
    for tick in range(8):
        if not run.can_step:
            waited.append(tick)
            run.schedulers[0].receive((tick - 2) * 0.01, valid_command)
        soil.ticks(1)
    assert waited == [2, 4, 6]


def test_late_command_takes_effect_at_once(make: MakeRun) -> None:
    run = make(command_delay=2)
    soil, delivered = Soil(run), []
    soil.ticks(5)
    run.schedulers[0].receive(0.01, lambda effect: not delivered.append(effect))
    assert delivered == [None]


@pytest.mark.parametrize("delay", [0, 2])
def test_answers_to_a_repeated_state_change_nothing(make: MakeRun, delay: int) -> None:
    """The joint of the first answers expires later than they arrive again."""
    applied: list[list[float]] = []
    for num_repetitions in (0, 3):
        run = make(command_wait_period=1, command_delay=delay)
        soil, scheduler = Soil(run), run.schedulers[0]

        def answer(tick: int, scheduler: CommandScheduler = scheduler) -> None:
            def deliver(effect_time: float | None) -> bool:
                joint = "boom" if tick < 3 else "arm"
                scheduler.arbiter.receive_joints(
                    [joint], [0.1 + 0.01 * tick], [], scheduler.sim_time, effect_time=effect_time
                )
                return True

            scheduler.receive(0.01 * tick, deliver)

        applied.append([])
        for tick in range(40):
            answer(tick)
            for _ in range(num_repetitions if tick > 1 else 0):  # a stamp of 0 is none
                answer(tick - 1)
            applied[-1] += soil.tick()[0].joints.tolist()
    assert applied[0] == applied[1]
    assert pytest.approx(0.12) in applied[0]


def test_commands_are_not_delayed_in_real_time(make: MakeRun) -> None:
    run = make(command_delay=5, realtime=True)
    Soil(run)
    delivered: list[float | None] = []
    run.schedulers[0].receive(0.0, lambda effect: not delivered.append(effect))
    assert delivered == [None]


def test_rejected_command_is_no_answer(make: MakeRun) -> None:
    run = make(command_wait_period=1)
    Soil(run)
    run.schedulers[0].receive(0.0, lambda _: False)
    assert not run.can_step


def test_resumed_run_awaits_each_answer_that_was_lost_until_later_ones_are_accepted(
    make: MakeRun,
) -> None:
    run = make(command_wait_period=1, command_delay=2)
    soil = Soil(run)

    def answer(tick: int) -> None:
        scheduler = run.schedulers[0]  # another one after each restart

        def deliver(effect_time: float | None) -> bool:
            scheduler.arbiter.receive_joints(
                ["boom"], [0.1], [], scheduler.sim_time, effect_time=effect_time
            )
            return True

        scheduler.receive(0.01 * tick, deliver)

    for tick in range(5):
        answer(tick)
        soil.ticks(1)
    answer(5)  # the answer to 4 has arrived, those to 3 and 5 are lost with the process
    state = run.state
    kept = tuple(
        each for each in state.arbiters[0].delayed if each.effect_time == pytest.approx(0.06)
    )
    run.resume(state._replace(arbiters=(state.arbiters[0]._replace(delayed=kept),)))
    assert run.tick == 5
    assert run.unanswered_ticks == {3, 5}
    answer(5)
    assert not run.can_step, "the answer to 3 is missing"
    answer(3)
    soil.ticks(2)
    assert run.unanswered_ticks == frozenset()
    run.resume(run.state._replace(arbiters=(run.state.arbiters[0]._replace(delayed=()),)))
    answer(run.tick)
    assert not run.can_step
    run.accept_later_answers()
    assert run.can_step


def test_terrain_is_needed_to_join_and_of_another_run(make: MakeRun) -> None:
    run = make()
    assert run.needs_map(RUN_ID)
    Soil(run)
    assert not run.needs_map(RUN_ID)
    assert run.needs_map(RUN_ID + 1)


def test_commands_are_not_awaited_in_real_time(make: MakeRun) -> None:
    run = make(command_wait_period=1, realtime=True)
    Soil(run)
    assert run.can_step


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


def test_stamp_of_another_clock_is_no_answer(make: MakeRun) -> None:
    run = make(command_wait_period=1)
    Soil(run)
    run.schedulers[0].receive(1.7e9, valid_command)  # seconds since 1970
    assert not run.can_step
