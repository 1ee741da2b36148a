"""HaulTask on a dumper that only moves: its phases and places, and other machines before it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import load_shipped_machine
from support.operator_scenes import observation, tilted

from dig_operator import HaulTask, HaulTaskParams, Observation
from dig_operator.observed_machine import ObservedMachine
from machine_sim.machine.errors import MachineError
from msg_bridge.contract.grid import Grid

DT = 0.02
DUMPER, DIGGER = load_shipped_machine("dumper"), load_shipped_machine("excavator")
MAP = Grid(257, 257, 0.2)  # 51 m
LEVEL = np.zeros(MAP.shape)
GAUGE = DUMPER.tracks.gauge
ROUND = ["approach", "spot", "load", "haul", "back", "tip", "pull_off", "lower"]


def digger_at(x: float, y: float, swing: float = 0.0) -> ObservedMachine:
    joints = np.array([swing, *DIGGER.home[1:]])
    return ObservedMachine("digger", DIGGER, np.array([x, y, 0.0]), np.eye(3), joints)


class KinematicDumper:
    """A dumper on level ground that follows its commands exactly; its bed fills while it waits."""

    def __init__(self, **params: float) -> None:
        self.task = HaulTask(DUMPER, HaulTaskParams.from_mapping(params))
        self.x, self.y, self.yaw, self.bed, self.fill, self.time = -9.0, 5.8, 2.0, 0.0, 0.0, 0.0
        self.others: tuple[ObservedMachine, ...] = ()
        self.filling_rate = 0.5
        self.phases: list[str] = []
        self.places: dict[str, tuple[float, float, float]] = {}

    def observation(self) -> Observation:
        seen = observation(
            [self.bed],
            position=(self.x, self.y, 0.0),
            rotation=tilted(yaw=self.yaw),
            fill=self.fill,
            time=self.time,
        )
        return replace(seen, others=self.others, bank_m3=6.0 * self.fill, grid=MAP, elevation=LEVEL)

    def step(self) -> None:
        phase = str(self.task.phase)
        if not self.phases or self.phases[-1] != phase:
            self.phases.append(phase)
        self.places[phase] = (self.x, self.y, self.yaw)
        command = self.task.command(self.observation(), DT)
        left, right = command.tracks.tolist()
        self.yaw += (right - left) / GAUGE * DT
        self.x += 0.5 * (left + right) * math.cos(self.yaw) * DT
        self.y += 0.5 * (left + right) * math.sin(self.yaw) * DT
        self.bed = min(max(self.bed + float(command.joints[0]) * DT, -1.15), 0.0)
        if phase == "load" and left == right == 0.0:
            self.fill = min(self.fill + self.filling_rate * DT, 0.9)
        if self.bed < -0.8:
            self.fill = max(self.fill - 0.5 * DT, 0.0)
        self.time += DT

    def run_until(self, phase: str, timeout: float = 300.0) -> KinematicDumper:
        end = self.time + timeout
        while self.task.phase != phase:
            assert self.time < end, self.task.phase
            self.step()
        return self


def test_rounds_lead_to_both_places_and_back() -> None:
    dumper = KinematicDumper(loads=2).run_until("done")
    assert dumper.phases == ROUND * 2
    x, y, yaw = dumper.places["load"]
    assert (x, y) == pytest.approx((0.0, 5.8), abs=0.15)
    assert math.remainder(yaw - math.pi, 2.0 * math.pi) == pytest.approx(0.0, abs=0.06)
    x, y, yaw = dumper.places["tip"]  # of the second load, 4 m to the left of the first
    assert (x, y) == pytest.approx((-13.0, -0.5), abs=0.15)
    assert math.remainder(yaw - 0.5 * math.pi, 2.0 * math.pi) == pytest.approx(0.0, abs=0.06)
    first, second = dumper.task.reports
    assert (first.number, second.number) == (1, 2)
    assert first.fill == pytest.approx(0.8, abs=0.15)
    assert first.moved_volume == pytest.approx(first.hauled_volume)
    assert dumper.bed == pytest.approx(0.0, abs=0.03)


def test_spot_follows_the_machine_that_loads() -> None:
    dumper = KinematicDumper(loader="digger", spot_x=0.0)
    dumper.filling_rate = 0.0
    dumper.others = (digger_at(2.0, 0.0),)
    dumper.run_until("load")
    arrived = dumper.time
    assert dumper.x == pytest.approx(2.0, abs=0.15)
    dumper.others = (digger_at(1.5, 0.0),)
    dumper.step()
    assert dumper.task.phase == "load", "near enough"
    dumper.others = (digger_at(-0.4, 0.0),)
    start = dumper.time
    dumper.run_until("spot").run_until("load")
    assert (dumper.x, dumper.y) == pytest.approx((-0.4, 5.8), abs=0.15)
    assert dumper.time - start < 8.0, "it pulls forward, and does not drive around"
    dumper.filling_rate = 0.5
    dumper.run_until("haul")
    total = dumper.time - arrived
    dumper.run_until("lower").run_until("approach")
    assert dumper.task.reports[0].loading_time == pytest.approx(total, abs=0.1)


def test_dumper_follows_across_its_heading_by_a_new_approach() -> None:
    dumper = KinematicDumper(loader="digger", via=[-14.0, 9.0])
    dumper.filling_rate = 0.0
    dumper.others = (digger_at(0.0, 0.0),)
    dumper.run_until("load")
    dumper.others = (digger_at(0.0, -1.5),)
    dumper.run_until("approach").run_until("load")
    assert (dumper.x, dumper.y) == pytest.approx((0.0, 4.3), abs=0.15)


def test_dumper_waits_until_it_is_known_where_the_machine_that_loads_is() -> None:
    dumper = KinematicDumper(loader="digger")
    for _ in range(50):
        dumper.step()
    assert (dumper.x, dumper.task.phase) == (-9.0, "approach")
    assert "digger" in dumper.task.wait_reason
    dumper.others = (digger_at(2.0, 0.0),)
    dumper.run_until("load")
    assert dumper.x == pytest.approx(2.0, abs=0.15)


def test_dumper_does_not_follow_below_a_bucket() -> None:
    dumper = KinematicDumper(loader="digger")
    dumper.filling_rate = 0.0
    dumper.others = (digger_at(0.0, 0.0),)
    dumper.run_until("load")
    dumper.others = (digger_at(-2.4, 0.0, swing=0.4 * math.pi),)
    for _ in range(100):
        dumper.step()
    assert dumper.task.phase == "load"
    assert "digger" in dumper.task.wait_reason


def test_task_is_aborted_when_a_machine_stays_in_the_way() -> None:
    dumper = KinematicDumper(obstacle_timeout=20.0).run_until("haul")
    dumper.others = (digger_at(-6.0, dumper.y),)
    for _ in range(1000):
        dumper.step()
    dumper.others = ()
    dumper.step()
    dumper.others = (digger_at(dumper.x - 6.0, dumper.y),)
    start = dumper.time
    dumper.run_until("done")
    assert 20.0 < dumper.time - start < 27.0, "since it stopped for it, not since the first time"
    assert "digger has been in the way for 20 s" in dumper.task.abort_reason


def test_task_is_aborted_when_the_part_of_the_tip_area_on_the_map_is_full() -> None:
    dumper = KinematicDumper(loads=5, tip_columns=5, tip_spacing=10.0).run_until("done", 600.0)
    assert len(dumper.task.reports) == 2
    assert "2 places, 3 others" in dumper.task.abort_reason
    assert dumper.bed == pytest.approx(0.0, abs=0.03)


def test_task_of_a_duration_ends_when_the_tip_area_is_full() -> None:
    params = {"loads": 5, "duration": 1000.0, "tip_columns": 1, "tip_rows": 2}
    dumper = KinematicDumper(**params).run_until("done", 600.0)
    assert len(dumper.task.reports) == 2
    assert dumper.task.abort_reason == ""
    assert dumper.places["tip"][1] == pytest.approx(-0.5 + 4.5, abs=0.15)


def test_empty_dumper_ends_after_the_duration_and_a_loaded_one_after_its_round() -> None:
    dumper = KinematicDumper(loads=9, duration=20.0)
    dumper.filling_rate = 0.05
    dumper.run_until("haul")
    assert dumper.time > 22.0, "it was loaded when the time was over"
    dumper.run_until("done")
    assert len(dumper.task.reports) == 1
    assert dumper.task.abort_reason == ""
    empty = KinematicDumper(loads=9, duration=20.0)
    empty.filling_rate = 0.0
    arrived = empty.run_until("load").time
    empty.run_until("done")
    assert empty.task.reports == []
    assert empty.time == pytest.approx(arrived + 60.0, abs=0.1), "soil might have arrived"


def test_dumper_leaves_with_what_it_has_when_no_soil_arrives_after_the_duration() -> None:
    dumper = KinematicDumper(loads=9, duration=20.0).run_until("load")
    dumper.filling_rate, dumper.fill = 0.0, 0.3
    dumper.run_until("haul").run_until("done")
    assert [report.fill for report in dumper.task.reports] == [0.3]


def test_dumper_with_soil_that_sticks_ends_after_the_duration() -> None:
    dumper = KinematicDumper(loads=9, duration=80.0, tip_timeout=10.0)
    dumper.run_until("haul")
    while len(dumper.task.reports) < 1:
        dumper.fill = max(dumper.fill, 0.1)
        dumper.step()
    dumper.filling_rate = 0.0
    dumper.run_until("done")
    assert len(dumper.task.reports) == 1


def test_task_is_aborted_when_the_bed_is_not_lowered() -> None:
    dumper = KinematicDumper().run_until("lower")
    start = dumper.time
    while not dumper.task.done:
        dumper.bed = -0.5  # a heap below it
        dumper.step()
    assert "lowered" in dumper.task.abort_reason
    joint = DUMPER.joints[DUMPER.joint_names[0]]
    limit = 3.0 * (joint.upper - joint.lower) / joint.max_velocity
    assert dumper.time - start == pytest.approx(limit, abs=0.1)


def test_way_leads_over_the_points_between() -> None:
    dumper = KinematicDumper(via=[-14.0, 9.0]).run_until("haul")
    distances = []
    while dumper.task.phase == "haul":
        dumper.step()
        distances.append(math.hypot(dumper.x + 14.0, dumper.y - 9.0))
    assert min(distances) < 0.3


def test_dumper_stops_before_a_machine_and_continues_without_it() -> None:
    dumper = KinematicDumper()
    dumper.run_until("spot")
    dumper.others = (digger_at(-2.0, 5.8),)
    while dumper.time < 60.0:
        dumper.step()
    assert "digger" in dumper.task.wait_reason
    assert dumper.task.phase == "spot"
    # Its rear is 2.5 m behind its middle, the other's tracks 2 m before theirs.
    assert -9.0 < dumper.x < -2.0 - 2.5 - 2.0
    dumper.others = ()
    dumper.run_until("load")
    assert dumper.task.wait_reason == ""


def test_full_dumper_leaves_only_when_nothing_is_above_it() -> None:
    dumper = KinematicDumper().run_until("load")
    dumper.others = (digger_at(0.0, 0.0, swing=0.5 * math.pi),)
    for _ in range(500):
        dumper.step()
    assert dumper.fill > 0.85
    assert dumper.task.phase == "load"
    assert "above" in dumper.task.wait_reason
    dumper.fill = 0.7  # the soil settles
    dumper.others = (digger_at(0.0, 0.0),)
    dumper.step()
    assert dumper.task.phase == "haul"


def test_dumper_does_not_turn_into_a_machine_beside_it() -> None:
    turning = KinematicDumper()
    turning.x, turning.y, turning.yaw = -9.0, 5.8, 1.0  # where the approach to the spot begins
    while turning.task.phase == "approach" and turning.yaw < 1.2:
        turning.step()
    turning.others = (digger_at(-9.0, 8.8),)
    for _ in range(200):
        turning.step()
    assert turning.task.phase == "approach"
    assert turning.yaw < 1.8
    assert "digger" in turning.task.wait_reason


def test_dumper_does_not_start_to_turn_beside_a_machine() -> None:
    beside = KinematicDumper()
    beside.x, beside.y, beside.yaw = -2.0, 5.8, 0.0
    beside.others = (digger_at(-2.0, 8.6),)
    for _ in range(200):
        beside.step()
    assert beside.task.phase == "approach"
    assert "digger" in beside.task.wait_reason


def test_finished_task_is_not_aborted_by_its_timeout() -> None:
    dumper = KinematicDumper(loads=1, timeout=200.0).run_until("done")
    while dumper.time < 210.0:
        dumper.step()
    assert dumper.task.abort_reason == ""


def test_wait_is_reported_only_when_no_soil_arrives() -> None:
    dumper = KinematicDumper()
    dumper.filling_rate = 0.005
    dumper.run_until("load")
    for _ in range(round(70.0 / DT)):
        dumper.step()
    assert dumper.task.wait_reason == ""
    dumper.filling_rate = 0.0
    for _ in range(round(70.0 / DT)):
        dumper.step()
    assert "soil" in dumper.task.wait_reason


def test_task_needs_a_bed() -> None:
    with pytest.raises(MachineError, match="bed"):
        HaulTask(DIGGER, HaulTaskParams())
