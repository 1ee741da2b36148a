"""DigTask: the approach, the cycles, and the wait until all soil is at rest."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import load_shipped_machine
from support.operator_scenes import MACHINE, observation, tilted

from dig_operator import OperatorPhase
from dig_operator.cycle_waypoints import WaypointPlanner
from dig_operator.dig_cycle import CycleReport
from dig_operator.dig_task import DigTask
from dig_operator.observation import Command, Observation
from dig_operator.observed_machine import ObservedMachine
from dig_operator.params import BehaviourParams, DigTaskParams
from machine_sim.machine.errors import ReachError

DT = 0.02


class FakeDigCycle:
    """Stands in for DigCycle: finishes a cycle each second; all joint velocities are 1."""

    def __init__(self, planner: WaypointPlanner) -> None:
        self.dig_azimuth, self.dump_target = planner.dig_azimuth, planner.dump_target
        self.reports: list[CycleReport] = []
        self.phase = OperatorPhase.REACH
        self.is_between_cycles = False
        self.start_time: float | None = None
        self.failure_time = math.inf
        self.plan_fraction, self.is_stowed = 1.0, False
        self.initial_plan_fraction = 1.0  # at each further station

    @property
    def cycle(self) -> int:
        return len(self.reports) + 1

    @property
    def has_dug(self) -> bool:
        return self.phase is not OperatorPhase.REACH and not self.is_between_cycles

    def stow(self) -> None:
        self.is_stowed = True

    def resume(self) -> None:
        self.is_stowed, self.start_time = False, None
        self.plan_fraction = self.initial_plan_fraction

    def command(self, observed: Observation, dt: float) -> Command:
        self.start_time = observed.time if self.start_time is None else self.start_time
        if observed.time >= self.failure_time:
            raise ReachError("the lip is out of reach")
        self.is_between_cycles = observed.time - self.start_time >= self.cycle - 1e-9
        if self.is_between_cycles:
            self.reports.append(CycleReport(self.cycle, 1, 1, 1, 1, 0, 1.0))
        self.phase = OperatorPhase.DIG
        return Command(np.ones(4), np.zeros(2))


@pytest.fixture
def dig_cycles(monkeypatch: pytest.MonkeyPatch) -> list[FakeDigCycle]:
    """Replace DigCycle, and list every one that a task creates."""
    created: list[FakeDigCycle] = []

    def create(planner: WaypointPlanner) -> FakeDigCycle:
        created.append(FakeDigCycle(planner))
        return created[-1]

    monkeypatch.setattr("dig_operator.dig_task.DigCycle", create)
    return created


class KinematicDrive:
    """A machine that drives as commanded along its yaw, and soil that moves until a given time."""

    def __init__(self, *, yaw: float = 0.0, start_time: float = 0.0, **params: float) -> None:
        self.task = DigTask(MACHINE, BehaviourParams(), DigTaskParams(**params))  # type: ignore[arg-type]
        self.yaw, self.distance, self.time = yaw, 0.0, start_time
        self.moving_until = self.height = 0.0
        self.others: tuple[ObservedMachine, ...] = ()
        self.phases: list[OperatorPhase] = []
        self.track_speeds: list[float] = []
        self.last = Command(np.zeros(4), np.zeros(2))

    def step(self) -> Command:
        x, y = self.distance * math.cos(self.yaw), self.distance * math.sin(self.yaw)
        observed = observation(
            position=(x, y, self.height), rotation=tilted(yaw=self.yaw), time=self.time
        )
        observed = replace(
            observed, is_soil_moving=self.time < self.moving_until, others=self.others
        )
        self.last = self.task.command(observed, DT)
        if not self.phases or self.phases[-1] != self.task.phase:
            self.phases.append(self.task.phase)
        self.track_speeds.append(float(self.last.tracks.mean()))
        self.distance += float(self.last.tracks.mean()) * DT
        self.time += DT
        return self.last

    def run_until(self, phase: OperatorPhase, timeout: float = 60.0) -> None:
        deadline = self.time + timeout
        while self.task.phase != phase:
            assert self.time < deadline, self.task.phase
            self.step()


def test_task_runs_from_approach_to_done(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=2)
    drive.run_until(OperatorPhase.DONE)
    assert drive.phases == ["approach", "brace", "dig", "settle", "done"]
    assert [report.number for report in drive.task.reports] == [1, 2]
    assert drive.task.done
    assert drive.task.abort_reason == ""


def test_approach_drives_straight_over_its_distance(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(approach_distance=3.0)
    assert drive.step().tracks.tolist() == [0.8, 0.8]
    assert not drive.last.joints.any()
    drive.run_until(OperatorPhase.BRACE)
    assert drive.distance == pytest.approx(3.0, abs=2 * DT)
    assert not drive.last.tracks.any()


def test_task_without_approach_starts_with_brace(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(approach_distance=0.0)
    drive.step()
    assert drive.task.phase is OperatorPhase.BRACE
    assert drive.distance == 0.0


def test_brace_takes_half_a_second(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(approach_distance=0.0)
    drive.run_until(OperatorPhase.DIG)
    assert drive.time == pytest.approx(0.5, abs=2 * DT)


def test_dig_is_ahead_and_dump_at_its_angle(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(yaw=0.4, dump_angle=-60.0)
    drive.run_until(OperatorPhase.DIG)
    (dig_cycle,) = dig_cycles
    assert dig_cycle.dig_azimuth == pytest.approx(0.4)
    assert dig_cycle.dump_target.aim(observation()).azimuth == pytest.approx(0.4 - math.pi / 3)


def test_cycles_are_numbered_from_1_to_the_last(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=3)
    numbers = []
    while not drive.task.done:
        drive.step()
        numbers.append(drive.task.cycle)
    assert sorted(set(numbers)) == [1, 2, 3]
    assert numbers == sorted(numbers)


def test_task_ends_when_soil_has_been_at_rest(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=1)
    drive.run_until(OperatorPhase.SETTLE)
    settle_start = drive.time
    drive.moving_until = settle_start + 1.0
    drive.run_until(OperatorPhase.DONE)
    assert drive.time - settle_start == pytest.approx(1.0 + 0.1, abs=3 * DT)


def test_wait_for_soil_that_never_rests_is_limited(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=1)
    drive.run_until(OperatorPhase.SETTLE)
    settle_start, drive.moving_until = drive.time, math.inf
    drive.run_until(OperatorPhase.DONE)
    assert drive.time - settle_start == pytest.approx(3.0, abs=3 * DT)


def test_finished_task_commands_zero_velocities(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=1)
    drive.run_until(OperatorPhase.DONE)
    for _ in range(5):
        command = drive.step()
        assert not command.joints.any()
        assert not command.tracks.any()


@pytest.mark.parametrize("start_time", [0.0, 5000.0])
def test_task_is_aborted_when_its_timeout_has_elapsed_since_its_start(
    dig_cycles: list[FakeDigCycle], start_time: float
) -> None:
    drive = KinematicDrive(cycles=1000, timeout=4.0, start_time=start_time)
    drive.run_until(OperatorPhase.DONE)
    assert "4 s" in drive.task.abort_reason
    assert 4.0 < drive.time - start_time < 4.5


def test_task_is_aborted_where_the_machine_cannot_reach(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=1000)
    drive.run_until(OperatorPhase.DIG)
    dig_cycles[0].failure_time = drive.time + 0.5
    drive.run_until(OperatorPhase.SETTLE)
    assert drive.task.abort_reason == "the lip is out of reach"
    assert not drive.last.joints.any()
    drive.run_until(OperatorPhase.DONE)
    assert drive.phases[-2:] == ["settle", "done"]


def test_abort_names_ground_that_yields(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=1000)
    drive.run_until(OperatorPhase.DIG)
    drive.height, drive.yaw = -0.5, drive.yaw + 0.35
    dig_cycles[0].failure_time = drive.time
    drive.run_until(OperatorPhase.SETTLE)
    reason = drive.task.abort_reason
    assert reason.startswith("the lip is out of reach; ")
    assert "sunk by 0.50 m and turned by 20 deg" in reason


def truck_at(x: float, y: float, fill: float = 0.0) -> ObservedMachine:
    spec = load_shipped_machine("dumper")
    return ObservedMachine("truck", spec, np.array([x, y, 0.0]), np.eye(3), spec.home, fill=fill)


def test_machine_moves_on_by_a_station_where_the_ground_is_dug_out(
    dig_cycles: list[FakeDigCycle],
) -> None:
    drive = KinematicDrive(
        yaw=0.3, cycles=4, approach_distance=0.0, stations=3, station_spacing=1.5
    )
    drive.run_until(OperatorPhase.DIG)
    dig_cycles[0].plan_fraction = 0.5
    drive.run_until(OperatorPhase.BRACE)
    assert drive.distance == pytest.approx(-1.5, abs=0.05)
    assert max(map(abs, drive.track_speeds)) <= 0.8
    drive.run_until(OperatorPhase.DONE)
    assert drive.phases == ["brace", "dig", "retreat", "brace", "dig", "settle", "done"]
    assert drive.task.station == 1
    assert len(dig_cycles) == 1
    assert len(drive.task.reports) == 4


def test_first_cycle_of_a_station_is_judged(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=9, approach_distance=0.0, stations=3, station_spacing=1.5)
    drive.run_until(OperatorPhase.DIG)
    dig_cycles[0].plan_fraction = dig_cycles[0].initial_plan_fraction = 0.5
    drive.run_until(OperatorPhase.RETREAT)
    num_cycles = len(drive.task.reports)
    drive.run_until(OperatorPhase.BRACE)
    drive.run_until(OperatorPhase.RETREAT)
    assert drive.task.station == 2
    assert len(drive.task.reports) == num_cycles


def test_machine_moves_on_where_no_ground_is_in_reach(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=2, approach_distance=0.0, stations=2, station_spacing=1.5)
    drive.run_until(OperatorPhase.DIG)
    dig_cycles[0].phase, dig_cycles[0].failure_time = OperatorPhase.REACH, drive.time
    drive.step()
    dig_cycles[0].failure_time = math.inf
    drive.run_until(OperatorPhase.DONE)
    assert drive.task.abort_reason == ""
    assert drive.task.station == 1


def test_retreat_stops_before_another_machine(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=9, approach_distance=0.0, stations=2, station_spacing=2.0)
    drive.run_until(OperatorPhase.DIG)
    dig_cycles[0].plan_fraction = 0.5
    drive.others = (truck_at(-5.5, 0.0),)
    drive.run_until(OperatorPhase.RETREAT)
    for _ in range(200):
        drive.step()
    assert drive.task.phase is OperatorPhase.RETREAT
    assert drive.distance > -1.0
    assert "truck" in drive.task.wait_reason


def test_last_station_is_dug_until_nothing_is_left(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(cycles=100, approach_distance=0.0)
    drive.run_until(OperatorPhase.DIG)
    dig_cycles[0].plan_fraction = 0.3
    for _ in range(200):
        drive.step()
    assert drive.task.phase is OperatorPhase.DIG
    dig_cycles[0].plan_fraction = 0.05
    drive.run_until(OperatorPhase.DONE)
    assert "dug out" in drive.task.abort_reason


def test_task_of_a_duration_ends_between_two_loads(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(duration=3.0, loads=9, truck="truck", approach_distance=0.0)  # type: ignore[arg-type]
    drive.others = (truck_at(0.0, 5.8, fill=0.4),)
    drive.run_until(OperatorPhase.DIG)
    target = dig_cycles[0].dump_target
    target.count_dump(replace(observation(), others=drive.others))
    target.watch(replace(observation(), others=(truck_at(0.0, 5.8),)))
    for _ in range(250):
        target.watch(replace(observation(), others=drive.others))
        drive.step()
    assert drive.task.phase is OperatorPhase.DIG, "the load is not full"
    target.count_dump(replace(observation(), others=(truck_at(0.0, 5.8, fill=0.8),)))
    target.watch(replace(observation(), others=(truck_at(0.0, 5.8, fill=0.8),)))
    drive.run_until(OperatorPhase.DONE)
    assert drive.task.abort_reason == ""


def test_duration_ends_no_cycle(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(duration=2.8, cycles=9, approach_distance=0.0)
    drive.run_until(OperatorPhase.SETTLE)
    assert len(drive.task.reports) == 3
    assert drive.time == pytest.approx(0.5 + 3.0, abs=0.1)


def test_bucket_that_waits_for_a_truck_ends_after_the_duration(
    dig_cycles: list[FakeDigCycle],
) -> None:
    drive = KinematicDrive(duration=2.8, truck="truck", approach_distance=0.0)  # type: ignore[arg-type]
    drive.run_until(OperatorPhase.DIG)
    dig_cycles[0].command = lambda observed, dt: Command(np.zeros(4), np.zeros(2))  # type: ignore[method-assign]
    dig_cycles[0].phase = OperatorPhase.WAIT
    drive.run_until(OperatorPhase.SETTLE)
    assert drive.time == pytest.approx(2.8, abs=0.1)


def test_approach_stops_before_another_machine(dig_cycles: list[FakeDigCycle]) -> None:
    drive = KinematicDrive(approach_distance=3.0)
    drive.others = (truck_at(12.0, 0.0),)
    assert drive.step().tracks.any()
    drive.others = (truck_at(5.5, 0.0),)
    assert not drive.step().tracks.any()
    assert "truck" in drive.task.wait_reason
    drive.others = ()
    drive.run_until(OperatorPhase.BRACE)
    assert drive.task.wait_reason == ""


def test_task_with_a_truck_ends_with_its_loads_and_not_its_cycles(
    dig_cycles: list[FakeDigCycle],
) -> None:
    drive = KinematicDrive(cycles=2, loads=1, truck="truck", approach_distance=0.0)  # type: ignore[arg-type]
    drive.others = (truck_at(0.0, 5.8),)
    drive.run_until(OperatorPhase.DIG)
    for _ in range(250):
        drive.step()
    (dig_cycle,) = dig_cycles
    assert len(drive.task.reports) > 2
    assert drive.task.phase is OperatorPhase.DIG
    full = replace(observation(), others=(truck_at(0.0, 5.8, fill=0.8),))
    dig_cycle.dump_target.count_dump(full)
    drive.run_until(OperatorPhase.DONE)
    assert drive.task.abort_reason == ""


def test_task_moves_the_joints_in_the_dig_cycle() -> None:
    drive = KinematicDrive(cycles=1, approach_distance=0.5)
    drive.run_until(OperatorPhase.REACH)
    assert any(drive.step().joints.any() for _ in range(10))
