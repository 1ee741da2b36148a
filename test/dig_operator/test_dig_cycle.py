"""DigCycle on a machine that only moves: its phases, its motion and its reports."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.operator_scenes import ARM, MACHINE, KinematicDig, observation, tilted

from dig_operator import BehaviourParams, DigCycle
from dig_operator.cycle_waypoints import WaypointPlanner
from dig_operator.dump_target import HeapTarget
from dig_operator.params import DigTaskParams
from machine_sim.machine.arm_kinematics import tool_pose

DT = 0.02
PASS = ["reach", "dig", "curl", "lift"]


def kinematic_dig(
    *,
    dig_azimuth: float = 0.0,
    dump_azimuth: float = math.pi / 2,
    params: dict | None = None,
    target: HeapTarget | None = None,
    **options,
) -> KinematicDig:
    behaviour = BehaviourParams.from_mapping(params or {})
    planner = WaypointPlanner(
        MACHINE,
        behaviour,
        dig_azimuth=dig_azimuth,
        dump_target=target or HeapTarget(dump_azimuth, behaviour.dump_radius),
    )
    return KinematicDig(DigCycle(planner), dt=DT, **options)


@pytest.fixture(scope="module")
def good() -> KinematicDig:
    """Two cycles of one pass each."""
    return kinematic_dig(start_time=5.0).run(cycles=2)


def planned_volumes(fills: tuple[float, ...], **options) -> list[float]:
    """Return the volume that each of two cycles planned to sweep [step^3]."""
    dig = kinematic_dig(fills=fills, **options).run(cycles=2)
    return [report.planned_volume for report in dig.dig_cycle.reports]


def test_phases_follow_in_order(good):
    assert good.phases == [*PASS, "swing", "dump"] * 2


def test_cycle_has_dug_from_its_first_drag_on():
    dig = kinematic_dig(fills=(0.5, 0.9)).run_until("dig")
    assert not dig.dig_cycle.has_dug
    dig.run_until("reach")
    assert dig.dig_cycle.has_dug, "another pass"
    dig.run()
    assert not dig.dig_cycle.has_dug


def test_lip_is_drawn_inward_below_the_surface(good):
    lips = np.array([step.lip for step in good.during("dig")])
    assert lips[0, 0] > lips[-1, 0] + 1.5
    assert lips[:, 2].min() < -0.2


def test_drag_stays_in_the_plane_of_the_dig_azimuth(good):
    drag = [step.lip[1] for step in good.during("dig") if step.observed.fill > 0.5]
    assert np.abs(drag).max() < 0.1
    assert max(abs(step.lip[1]) for step in good.during("dig")) < 0.5 * MACHINE.bucket.width


def test_lip_enters_the_ground_only_to_dig_and_curl(good):
    for phase in ("lift", "swing", "dump"):
        assert min(step.lip[2] for step in good.during(phase)) > 0.0, phase
    assert min(step.lip[2] for step in good.during("reach")) > -0.05


def test_bucket_is_level_during_the_swing(good):
    for step in good.during("swing"):
        assert ARM.bucket_pose(step.observed).attitude == pytest.approx(
            ARM.level_attitude, abs=0.25
        )


def test_bucket_empties_at_the_dump_azimuth_and_radius(good):
    emptying = [step for step in good.during("dump") if 0.0 < step.observed.fill < 0.85]
    assert emptying
    for step in emptying:
        pose = ARM.bucket_pose(step.observed)
        assert pose.azimuth == pytest.approx(math.pi / 2, abs=0.1)
        assert pose.radius == pytest.approx(BehaviourParams().dump_radius, abs=0.05)


def test_commanded_accelerations_are_limited(good):
    velocities = np.array([step.command.joints for step in good.steps])
    change = np.abs(np.diff(velocities, axis=0, prepend=np.zeros((1, 4)))).max(axis=0)
    assert (change <= np.array(BehaviourParams().max_joint_accelerations) * DT + 1e-12).all()


def test_tracks_stand_still(good):
    assert all((step.command.tracks == 0.0).all() for step in good.steps)


def test_report_holds_the_fills_of_each_cycle(good):
    first, second = good.dig_cycle.reports
    assert (first.number, second.number) == (1, 2)
    assert (first.num_passes, second.num_passes) == (1, 1)
    target = BehaviourParams().target_fill * MACHINE.bucket.heaped_capacity
    assert 0.8 * target < first.planned_volume < 1.05 * target
    assert (first.carried_fill, first.delivered_fill) == (0.9, 0.9)
    assert first.residual_fill <= BehaviourParams().empty_threshold


def test_durations_do_not_include_the_time_before_the_first_cycle(good):
    durations = [report.duration for report in good.dig_cycle.reports]
    assert sum(durations) == pytest.approx(len(good.steps) * DT, abs=2 * DT)
    assert durations[1] == pytest.approx(durations[0], abs=5.0)


@pytest.mark.parametrize("target_fill", [1.0, 1.6, 2.0])
def test_undug_ground_is_enough_for_any_adapted_volume(target_fill):
    planner = WaypointPlanner(
        MACHINE, BehaviourParams(), dig_azimuth=0.0, dump_target=HeapTarget(1.5, 6.0)
    )
    planner.plan_pass(observation(), target_fill, is_first=True)
    assert planner.plan_fraction > DigTaskParams().min_plan_fraction


def test_bucket_that_is_not_full_digs_another_pass():
    dig = kinematic_dig(fills=(0.5, 0.9)).run()
    assert dig.phases == [*PASS, *PASS, "swing", "dump"]
    assert dig.dig_cycle.reports[0].num_passes == 2
    assert dig.dig_cycle.reports[0].carried_fill == 0.9


def test_loaded_bucket_stays_level_until_the_next_pass():
    dig = kinematic_dig(fills=(0.5, 0.9)).run()
    second_reach = [step for step in dig.during("reach") if step.num_passes == 1]
    high = [step for step in second_reach if step.lip[2] > 1.0]
    assert high
    for step in high:
        assert ARM.bucket_pose(step.observed).attitude > ARM.level_attitude - 1.4


@pytest.mark.parametrize("max_passes", [1, 3])
def test_bucket_that_never_fills_is_dumped_after_the_maximum_of_passes(max_passes):
    dig = kinematic_dig(fills=(0.3,), params={"max_passes": max_passes}).run()
    assert dig.phases == [*PASS * max_passes, "swing", "dump"]
    report = dig.dig_cycle.reports[0]
    assert (report.num_passes, report.carried_fill) == (max_passes, 0.3)


def test_overfull_bucket_ends_the_drag_early(good):
    overfull = kinematic_dig(fills=(1.3,), drag_time=1.0).run()
    full_drag = [step for step in good.during("dig") if step.num_passes == 1]
    assert len(overfull.during("dig")) < 0.5 * len(full_drag)
    last = overfull.during("dig")[-1]
    assert last.observed.fill == pytest.approx(BehaviourParams().overfill_threshold, abs=0.05)


def test_cycle_plans_more_after_a_fill_that_was_too_small():
    first, second = planned_volumes((0.5, 0.9, 0.9), params={"target_fill": 0.7})
    assert second == pytest.approx(1.1 * first, rel=0.03)


def test_cycle_plans_less_after_an_overfull_bucket():
    first, second = planned_volumes((1.3,), params={"target_fill": 0.9})
    assert second == pytest.approx(0.95 * first, rel=0.03)


def test_cycle_plans_the_same_after_a_full_bucket(good):
    first, second = (report.planned_volume for report in good.dig_cycle.reports)
    assert second == first


def test_small_target_fill_is_not_raised_by_an_overfull_bucket():
    first, second = planned_volumes((1.3,), params={"target_fill": 0.4})
    assert second <= first


def test_dump_ends_when_the_bucket_is_empty():
    dig = kinematic_dig(emptying_rate=0.2, params={"dump_timeout": 60.0}).run()
    dump = dig.during("dump")
    assert dump[-1].observed.fill <= BehaviourParams().empty_threshold
    assert dump[-2].observed.fill > BehaviourParams().empty_threshold
    assert dig.dig_cycle.reports[0].residual_fill <= BehaviourParams().empty_threshold


@pytest.mark.parametrize("timeout", [1.0, 3.0])
def test_dump_of_adhering_soil_ends_after_the_timeout(timeout):
    dig = kinematic_dig(emptying_rate=0.0, params={"dump_timeout": timeout}).run()
    open_attitude = ARM.level_attitude - BehaviourParams().dump_opening_angle
    open_steps = [
        step
        for step in dig.during("dump")
        if abs(ARM.bucket_pose(step.observed).attitude - open_attitude) < 0.02
    ]
    assert len(open_steps) * DT == pytest.approx(timeout, abs=0.4)
    assert dig.dig_cycle.reports[0].residual_fill == 0.9


def test_swing_takes_the_shorter_direction_to_a_dig_behind_the_machine():
    dig = kinematic_dig(dig_azimuth=math.pi, dump_azimuth=-math.pi / 2).run(cycles=2)
    swing = np.array([step.observed.joints[0] for step in dig.steps])
    assert np.ptp(swing) < 1.5 * math.pi + 0.3


def test_cycle_behind_the_machine_takes_as_long_as_one_ahead(good):
    behind = kinematic_dig(dig_azimuth=math.pi, dump_azimuth=-math.pi / 2).run(cycles=2)
    durations = [dig.dig_cycle.reports[1].duration for dig in (behind, good)]
    assert durations[0] == pytest.approx(durations[1], abs=1.0)


def test_phase_ends_when_its_motion_is_done():
    slow = kinematic_dig(params={"dig_speed": 0.3}).run()
    fast = kinematic_dig(params={"dig_speed": 0.9}).run()
    assert len(slow.during("dig")) > 1.5 * len(fast.during("dig"))


class BusyTarget(HeapTarget):
    """A heap that cannot be used while `reason` is not empty."""

    reason = ""

    def find_obstacle(self, observation, *, is_swinging):
        return self.reason


def test_loaded_bucket_waits_where_it_was_filled_until_the_target_is_ready():
    target = BusyTarget(math.pi / 2, BehaviourParams().dump_radius)
    target.reason = "the truck"
    dig = kinematic_dig(target=target).run_until("wait")
    swing = dig.steps[-1].observed.joints[0]
    dig.step(ticks=200)
    assert dig.dig_cycle.phase == "wait"
    assert dig.dig_cycle.wait_reason == "the truck"
    assert dig.steps[-1].observed.joints[0] == pytest.approx(swing, abs=0.02)
    target.reason = ""
    dig.run()
    assert dig.phases == [*PASS, "wait", "swing", "dump"]
    assert dig.dig_cycle.wait_reason == ""


@pytest.mark.parametrize("phase", ["swing", "dump"])
def test_bucket_stops_when_the_target_is_lost_and_continues_later(phase):
    target = BusyTarget(math.pi / 2, BehaviourParams().dump_radius)
    dig = kinematic_dig(target=target).run_until(phase)
    if phase == "dump":
        while dig.steps[-1].observed.fill > 0.6:
            dig.step(ticks=1)
    else:
        dig.step(ticks=30)
    target.reason = "the truck"
    dig.step(ticks=150)
    assert dig.dig_cycle.phase == "wait"
    assert np.abs(dig.steps[-1].command.joints).max() < 0.01
    target.reason = ""
    dig.run()
    (report,) = dig.dig_cycle.reports
    assert report.delivered_fill == 0.9, "as at the first arrival"
    assert report.residual_fill <= BehaviourParams().empty_threshold


def pitched_forward(dig: KinematicDig, fill: float, ticks: int = 20) -> np.ndarray:
    """Return the joint velocities [rad/s] commanded after the base pitches by 0.2 rad."""
    observed = replace(dig.steps[-1].observed, base_rotation=tilted(pitch=0.2), fill=fill)
    for _ in range(ticks):
        command = dig.dig_cycle.command(observed, DT)
    return command.joints


def test_tilting_machine_spills_some_of_its_load():
    joints = pitched_forward(kinematic_dig().run_until("lift"), fill=0.9)
    assert joints[3] < -0.2, "the bucket opens"
    assert joints[:3] == pytest.approx(np.zeros(3), abs=0.01), "the arm stops"


def test_tilting_machine_with_an_empty_bucket_continues():
    dig = kinematic_dig().run_until("lift")
    assert pitched_forward(dig, fill=0.0)[1] < -0.05, "the boom lifts"


def test_tilting_machine_continues_with_soil_that_sticks_to_its_open_bucket():
    dig = kinematic_dig().run_until("lift")
    joints = dig.steps[-1].observed.joints.copy()
    joints[3] = MACHINE.joints["bucket"].lower
    dig.steps[-1] = dig.steps[-1]._replace(observed=replace(dig.steps[-1].observed, joints=joints))
    timeout_ticks = round(BehaviourParams().dump_timeout / DT)
    assert pitched_forward(dig, fill=0.05, ticks=timeout_ticks)[3] < -0.2, "it spills"
    assert pitched_forward(dig, fill=0.05, ticks=100)[1] < -0.05, "the boom lifts"


def test_floor_of_the_bucket_keeps_its_relief_angle():
    steps = kinematic_dig().run().during("dig")
    (x, z) = MACHINE.bucket.profile[1]
    max_drag_height = min(step.lip[2] for step in steps[:-20]) + 0.04
    drag = [step for step in steps if step.lip[2] < max_drag_height]
    assert len(drag) > 40
    for step in drag[: int(0.8 * len(drag))]:  # without the exit
        observed = step.observed
        rotation, pin = tool_pose(MACHINE, observed.base_position, np.eye(3), observed.joints)
        floor = step.lip - (pin + rotation @ np.array([x, 0.0, z]))
        assert floor[2] < 0.0, "the heel is above the lip"
