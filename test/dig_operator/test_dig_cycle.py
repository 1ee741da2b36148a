"""The operator at the levers of a machine that only moves: what it does, in which order."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.operator_scenes import ARM, MACHINE, KinematicDig

from dig_operator import BehaviourParams, DigCycle
from machine_sim.machine.arm_kinematics import tool_pose

DT = 0.02
ROUND = ["reach", "dig", "curl", "lift"]


def toy(
    *,
    dig_azimuth: float = 0.0,
    dump_azimuth: float = math.pi / 2,
    params: dict | None = None,
    **options,
) -> KinematicDig:
    operator = DigCycle(
        MACHINE,
        BehaviourParams.from_mapping(params or {}),
        dig_azimuth=dig_azimuth,
        dump_azimuth=dump_azimuth,
    )
    return KinematicDig(operator, dt=DT, **options)


@pytest.fixture(scope="module")
def good() -> KinematicDig:
    """Two cycles in which the bucket comes out full at once."""
    return toy(start_time=5.0).run(cycles=2)


def planned(fills: tuple[float, ...], **options) -> list[float]:
    """Soil that each of two cycles planned to sweep [m^3]."""
    dig = toy(fills=fills, **options).run(cycles=2)
    return [report.planned_volume for report in dig.operator.reports]


def test_phases_come_in_order(good):
    assert good.phases == [*ROUND, "swing", "dump"] * 2


def test_dig_runs_from_far_to_near_in_the_ground(good):
    lips = np.array([moment.lip for moment in good.during("dig")])
    assert lips[0, 0] > lips[-1, 0] + 1.5
    assert lips[:, 2].min() < -0.2


def test_dig_keeps_to_its_direction_once_the_swing_has_come_to_rest(good):
    drag = [m.lip[1] for m in good.during("dig") if m.seen.fill > 0.5]
    assert np.abs(drag).max() < 0.1
    assert max(abs(m.lip[1]) for m in good.during("dig")) < 0.5 * MACHINE.bucket.width


def test_lip_stays_out_of_the_ground_but_for_digging_and_curling(good):
    for phase in ("lift", "swing", "dump"):
        assert min(moment.lip[2] for moment in good.during(phase)) > 0.0, phase
    assert min(moment.lip[2] for moment in good.during("reach")) > -0.05


def test_bucket_is_carried_with_its_mouth_up(good):
    for moment in good.during("swing"):
        assert ARM.bucket_pose(moment.seen).attitude == pytest.approx(ARM.level_attitude, abs=0.25)


def test_bucket_is_dumped_in_the_direction_of_the_dump(good):
    falling = [m for m in good.during("dump") if 0.0 < m.seen.fill < 0.85]
    assert falling
    for moment in falling:
        place = ARM.bucket_pose(moment.seen)
        assert place.azimuth == pytest.approx(math.pi / 2, abs=0.1)
        assert place.radius == pytest.approx(BehaviourParams().dump_radius, abs=0.05)


def test_levers_are_never_jerked(good):
    velocities = np.array([moment.command.joints for moment in good.moments])
    change = np.abs(np.diff(velocities, axis=0, prepend=np.zeros((1, 4)))).max(axis=0)
    assert (change <= np.array(BehaviourParams().max_joint_accelerations) * DT + 1e-12).all()


def test_tracks_are_left_alone(good):
    assert all((moment.command.tracks == 0.0).all() for moment in good.moments)


def test_reports_tell_how_each_cycle_went(good):
    first, second = good.operator.reports
    assert (first.number, second.number) == (1, 2)
    assert (first.num_passes, second.num_passes) == (1, 1)
    assert first.planned_volume == pytest.approx(MACHINE.bucket.heaped_capacity, rel=0.1)
    assert (first.carried_fill, first.delivered_fill) == (0.9, 0.9)
    assert first.residual_fill <= BehaviourParams().empty_threshold


def test_durations_are_those_of_the_cycles_and_not_of_what_was_before(good):
    durations = [report.duration for report in good.operator.reports]
    assert sum(durations) == pytest.approx(len(good.moments) * DT, abs=2 * DT)
    assert durations[1] == pytest.approx(durations[0], abs=5.0)


def test_bucket_that_is_not_full_digs_again():
    dig = toy(fills=(0.5, 0.9)).run()
    assert dig.phases == [*ROUND, *ROUND, "swing", "dump"]
    assert dig.operator.reports[0].num_passes == 2
    assert dig.operator.reports[0].carried_fill == 0.9


def test_another_pass_keeps_what_is_in_the_bucket():
    dig = toy(fills=(0.5, 0.9)).run()
    again = [moment for moment in dig.during("reach") if moment.num_passes == 1]
    high = [moment for moment in again if moment.lip[2] > 1.0]
    assert high  # on its way over the ground
    for moment in high:
        assert ARM.bucket_pose(moment.seen).attitude > ARM.level_attitude - 1.4


@pytest.mark.parametrize("most", [1, 3])
def test_bucket_that_never_fills_is_carried_after_the_most_passes(most):
    dig = toy(fills=(0.3,), params={"max_passes": most}).run()
    assert dig.phases == [*ROUND * most, "swing", "dump"]
    assert (dig.operator.reports[0].num_passes, dig.operator.reports[0].carried_fill) == (most, 0.3)


def test_brimming_bucket_ends_the_drag_early(good):
    overfill_threshold = toy(fills=(1.3,), drag_time=1.0).run()
    in_time = [moment for moment in good.during("dig") if moment.num_passes == 1]
    assert len(overfill_threshold.during("dig")) < 0.5 * len(in_time)
    last = overfill_threshold.during("dig")[-1]
    assert last.seen.fill == pytest.approx(BehaviourParams().overfill_threshold, abs=0.05)


def test_short_cycle_plans_more_next_time():
    first, second = planned((0.5, 0.9, 0.9), params={"target_fill": 0.7})
    assert second == pytest.approx(1.1 * first, rel=0.03)


def test_brimming_cycle_plans_less_next_time():
    first, second = planned((1.3,), params={"target_fill": 0.9})
    assert second == pytest.approx(0.95 * first, rel=0.03)


def test_good_cycle_plans_the_same_next_time(good):
    first, second = (report.planned_volume for report in good.operator.reports)
    assert second == first


def test_small_appetite_is_not_raised_by_a_brimming_bucket():
    first, second = planned((1.3,), params={"target_fill": 0.4})
    assert second <= first


def test_dump_goes_on_until_the_bucket_is_empty_and_no_longer():
    dig = toy(emptying=0.2, params={"dump_timeout": 60.0}).run()
    dump = dig.during("dump")
    assert dump[-1].seen.fill <= BehaviourParams().empty_threshold
    assert dump[-2].seen.fill > BehaviourParams().empty_threshold
    assert dig.operator.reports[0].residual_fill <= BehaviourParams().empty_threshold


@pytest.mark.parametrize("wait", [1.0, 3.0])
def test_dump_of_soil_that_sticks_is_given_up_after_the_wait(wait):
    dig = toy(emptying=0.0, params={"dump_timeout": wait}).run()
    open_ = ARM.level_attitude - BehaviourParams().dump_opening_angle
    stood = [m for m in dig.during("dump") if abs(ARM.bucket_pose(m.seen).attitude - open_) < 0.02]
    assert len(stood) * DT == pytest.approx(wait, abs=0.4)
    assert dig.operator.reports[0].residual_fill == 0.9


def test_machine_does_not_turn_all_the_way_round_to_dig_behind_it():
    dig = toy(dig_azimuth=math.pi, dump_azimuth=-math.pi / 2).run(cycles=2)
    swing = np.array([moment.seen.joints[0] for moment in dig.moments])
    assert np.ptp(swing) < 1.5 * math.pi + 0.3  # from ahead to the dump, and a little overshoot


def test_cycle_behind_the_machine_takes_as_long_as_one_ahead(good):
    behind = toy(dig_azimuth=math.pi, dump_azimuth=-math.pi / 2).run(cycles=2)
    durations = [dig.operator.reports[1].duration for dig in (behind, good)]
    assert durations[0] == pytest.approx(durations[1], abs=1.0)


def test_phase_does_not_change_before_its_motion_is_done():
    held = toy(params={"dig_speed": 0.3}).run()
    quick = toy(params={"dig_speed": 0.9}).run()
    assert len(held.during("dig")) > 1.5 * len(quick.during("dig"))


def leaning(dig: KinematicDig, fill: float, ticks: int = 20) -> np.ndarray:
    """What it does once its machine leans forward by 0.2 rad: joint velocities."""
    lean = math.cos(0.2), math.sin(0.2)
    over = np.array([[lean[0], 0.0, lean[1]], [0.0, 1.0, 0.0], [-lean[1], 0.0, lean[0]]])
    seen = replace(dig.moments[-1].seen, base_rotation=over, fill=fill)
    for _ in range(ticks):
        command = dig.operator.command(seen, DT)
    return command.joints


def test_machine_that_leans_under_its_load_lets_some_of_it_fall():
    joints = leaning(toy().run_until("lift"), fill=0.9)
    assert joints[3] < -0.2, "it opens"
    assert joints[:3] == pytest.approx(np.zeros(3), abs=0.01), "and waits"


def test_machine_that_leans_with_an_empty_bucket_goes_on():
    dig = toy().run_until("lift")
    assert leaning(dig, fill=0.0)[1] < -0.05, "it lifts"


def test_floor_of_the_bucket_does_not_drag_over_the_ground_behind_the_lip():
    moments = toy().run().during("dig")
    (x, z) = MACHINE.bucket.profile[1]
    level_attitude = min(moment.lip[2] for moment in moments[:-20]) + 0.04
    drag = [moment for moment in moments if moment.lip[2] < level_attitude]
    assert len(drag) > 40
    for moment in drag[: int(0.8 * len(drag))]:  # then it goes up, and may lie flat
        seen = moment.seen
        rotation, pin = tool_pose(MACHINE, seen.base_position, np.eye(3), seen.joints)
        floor = moment.lip - (pin + rotation @ np.array([x, 0.0, z]))
        assert floor[2] < 0.0, "the heel is higher than the lip"
