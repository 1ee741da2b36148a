"""A shift: the way to the dig, its cycles, and the wait until all soil lies."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from support.operator_scenes import MACHINE, observation, tilted

from dig_operator.dig_cycle import CycleReport, DigCycle
from dig_operator.dig_task import DigTask
from dig_operator.observation import Command, Observation
from dig_operator.params import BehaviourParams, DigTaskParams
from machine_sim.machine.errors import ReachError

DT = 0.02


class Reporter:
    """Stands for the dig cycle: one cycle each second, its commands all ones."""

    def __init__(self, dig_azimuth: float = 0.0, dump_azimuth: float = 0.0) -> None:
        self.dig_azimuth, self.dump_azimuth = dig_azimuth, dump_azimuth
        self.reports: list[CycleReport] = []
        self.phase = "reach"
        self.begun: float | None = None
        self.fails_at = math.inf

    @property
    def cycle(self) -> int:
        return len(self.reports) + 1

    def command(self, seen: Observation, dt: float) -> Command:
        self.begun = seen.time if self.begun is None else self.begun
        if seen.time >= self.fails_at:
            raise ReachError("the lip cannot get there")
        if seen.time - self.begun >= self.cycle - 1e-9:
            self.reports.append(CycleReport(self.cycle, 1, 1, 1, 1, 0, 1.0))
        self.phase = "dig"
        return Command(np.ones(4), np.zeros(2))


@pytest.fixture
def diggers(monkeypatch: pytest.MonkeyPatch) -> list[Reporter]:
    """Every dig cycle that a shift made."""
    made: list[Reporter] = []

    def make(
        machine: object, behaviour: object, *, dig_azimuth: float, dump_azimuth: float
    ) -> Reporter:
        made.append(Reporter(dig_azimuth, dump_azimuth))
        return made[-1]

    monkeypatch.setattr("dig_operator.dig_task.DigCycle", make)
    return made


class World:
    """A machine that drives as it is told along its yaw, and soil that moves until told not to."""

    def __init__(self, *, yaw: float = 0.0, **task: float) -> None:
        self.dig_task = DigTask(MACHINE, BehaviourParams(), DigTaskParams(**task))  # type: ignore[arg-type]
        self.yaw, self.way, self.time = yaw, 0.0, 0.0
        self.moving_until = 0.0
        self.phases: list[str] = []
        self.last = Command(np.zeros(4), np.zeros(2))

    def look(self) -> Command:
        x, y = self.way * math.cos(self.yaw), self.way * math.sin(self.yaw)
        seen = observation(position=(x, y, 0.0), rotation=tilted(yaw=self.yaw), time=self.time)
        seen = replace(seen, is_soil_moving=self.time < self.moving_until)
        self.last = self.dig_task.command(seen, DT)
        if not self.phases or self.phases[-1] != self.dig_task.phase:
            self.phases.append(self.dig_task.phase)
        self.way += float(self.last.tracks.mean()) * DT
        self.time += DT
        return self.last

    def until(self, phase: str, timeout: float = 60.0) -> None:
        while self.dig_task.phase != phase:
            assert self.time < timeout, self.dig_task.phase
            self.look()


def test_a_shift_goes_from_the_approach_to_done(diggers: list[Reporter]) -> None:
    world = World(cycles=2)
    world.until("done")
    assert world.phases == ["approach", "brace", "dig", "settle", "done"]
    assert [report.number for report in world.dig_task.reports] == [1, 2]
    assert world.dig_task.done
    assert world.dig_task.abort_reason == ""


def test_it_drives_straight_as_far_as_it_is_told(diggers: list[Reporter]) -> None:
    world = World(approach=3.0)
    assert world.look().tracks.tolist() == [0.8, 0.8]
    assert not world.last.joints.any()
    world.until("brace")
    assert world.way == pytest.approx(3.0, abs=2 * DT)
    assert not world.last.tracks.any()


def test_without_an_approach_it_begins_where_it_stands(diggers: list[Reporter]) -> None:
    world = World(approach=0.0)
    world.look()
    assert world.dig_task.phase == "brace"
    assert world.way == 0.0


def test_it_stands_half_a_second_before_it_digs(diggers: list[Reporter]) -> None:
    world = World(approach=0.0)
    world.until("dig")
    assert world.time == pytest.approx(0.5, abs=2 * DT)


def test_it_digs_where_it_faced_and_dumps_at_the_angle_it_is_told(
    diggers: list[Reporter],
) -> None:
    world = World(yaw=0.4, dump_angle=-60.0)
    world.until("dig")
    (digger,) = diggers
    assert digger.dig_azimuth == pytest.approx(0.4)
    assert digger.dump_azimuth == pytest.approx(0.4 - math.pi / 3)


def test_the_cycle_is_numbered_from_1_to_the_last(diggers: list[Reporter]) -> None:
    world = World(cycles=3)
    seen = []
    while not world.dig_task.done:
        world.look()
        seen.append(world.dig_task.cycle)
    assert sorted(set(seen)) == [1, 2, 3]
    assert seen == sorted(seen)
    assert seen[-1] == 3


def test_it_leaves_once_soil_has_lain_still_for_a_while(diggers: list[Reporter]) -> None:
    world = World(cycles=1)
    world.until("settle")
    began = world.time
    world.moving_until = began + 1.0
    world.until("done")
    assert world.time - began == pytest.approx(1.0 + 0.1, abs=3 * DT)


def test_soil_that_never_lies_is_not_waited_for_for_ever(diggers: list[Reporter]) -> None:
    world = World(cycles=1)
    world.until("settle")
    began, world.moving_until = world.time, math.inf
    world.until("done")
    assert world.time - began == pytest.approx(3.0, abs=3 * DT)


def test_once_done_it_touches_no_lever(diggers: list[Reporter]) -> None:
    world = World(cycles=1)
    world.until("done")
    for _ in range(5):
        command = world.look()
        assert not command.joints.any()
        assert not command.tracks.any()


def test_it_gives_up_when_the_time_is_over_and_says_why(diggers: list[Reporter]) -> None:
    world = World(cycles=1000, timeout=4.0)
    world.until("done")
    assert "4.0 s of simulated time were not enough" in world.dig_task.abort_reason
    assert 4.0 < world.time < 4.5


def test_it_gives_up_what_it_cannot_reach_and_holds_still(diggers: list[Reporter]) -> None:
    world = World(cycles=1000)
    world.until("dig")
    diggers[0].fails_at = world.time + 0.5
    world.until("settle")
    assert world.dig_task.abort_reason == "the lip cannot get there"
    assert not world.last.joints.any()
    world.until("done")
    assert world.phases[-2:] == ["settle", "done"]


def test_with_the_real_dig_cycle_it_goes_through_its_phases() -> None:
    world = World(cycles=1, approach=0.5)
    world.until("reach")
    assert isinstance(world.dig_task._dig_cycle, DigCycle)
    assert any(world.look().joints.any() for _ in range(10))
