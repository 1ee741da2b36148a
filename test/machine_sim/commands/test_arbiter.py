"""Arbitration: the newest command applies until it times out, none under an emergency stop."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

from machine_sim.commands import CommandError
from machine_sim.machine import EXCAVATOR_JOINTS

HOME = (0.0, -0.7, 1.85, 1.9)
NONE = ("none",) * 4


def joints(arbiter, now):
    return arbiter.command_at(now, HOME).joints.tolist()


def tracks(arbiter, now):
    return arbiter.command_at(now, HOME).tracks.tolist()


def test_velocities_are_zero_without_commands(make_arbiter):
    applied = make_arbiter().command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.0] * 4
    assert applied.tracks.tolist() == [0.0] * 2
    assert (applied.joint_sources, applied.track_sources) == (NONE, ("none", "none"))


def test_front_command_is_in_joint_order(make_arbiter, spec):
    assert tuple(spec.joints) == EXCAVATOR_JOINTS
    arbiter = make_arbiter()
    arbiter.receive_front([0.1, 0.2, 0.3, 0.4], 0.0)
    applied = arbiter.command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert applied.joint_sources == ("front",) * 4
    assert applied.track_sources == ("none",) * 2


def test_track_command_is_left_then_right(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_tracks(np.array([0.5, -0.5]), 0.0)
    assert tracks(arbiter, 0.0) == [0.5, -0.5]
    assert arbiter.command_at(0.0, HOME).track_sources == ("tracks",) * 2


def test_command_applies_until_timeout_then_zero(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1, 0.0, 0.0, 0.0], 5.0)
    assert joints(arbiter, 5.3)[0] == 0.1
    assert joints(arbiter, 5.301)[0] == 0.0
    assert arbiter.command_at(5.302, HOME).joint_sources == NONE


def test_command_renewed_at_each_timeout_survives_rounding_of_times(make_arbiter):
    arbiter, seen = make_arbiter(), set()
    for tick in range(3000):
        if tick % 30 == 0:
            arbiter.receive_front([0.1, 0.0, 0.0, 0.0], tick * 0.01)
        seen.add(joints(arbiter, tick * 0.01)[0])
    assert seen == {0.1}


def test_timeout_is_a_parameter(make_arbiter):
    arbiter = make_arbiter(command_timeout=1.0)
    arbiter.receive_tracks([1.0, 1.0], 0.0)
    assert tracks(arbiter, 0.9) == [1.0, 1.0]
    assert tracks(arbiter, 1.1) == [0.0, 0.0]


def test_expired_command_stays_expired(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1] * 4, 0.0)
    assert joints(arbiter, 1.0) == [0.0] * 4
    assert joints(arbiter, 1.05) == [0.0] * 4


def test_newest_command_of_each_joint_applies(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1, 0.1, 0.1, 0.1], 0.0)
    arbiter.receive_joints(["arm"], [0.3], [], 0.1)
    applied = arbiter.command_at(0.1, HOME)
    assert applied.joints.tolist() == [0.1, 0.1, 0.3, 0.1]
    assert applied.joint_sources == ("front", "front", "joints", "front")
    arbiter.receive_front([0.2, 0.2, 0.2, 0.2], 0.11)
    assert joints(arbiter, 0.11) == [0.2] * 4


def test_partial_commands_of_one_source_time_out_separately(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_joints(["boom"], [0.2], [], 0.0)
    arbiter.receive_joints(["arm"], [0.3], [], 0.2)
    assert joints(arbiter, 0.25) == [0.0, 0.2, 0.3, 0.0]
    assert joints(arbiter, 0.4) == [0.0, 0.0, 0.3, 0.0]


def test_joint_command_may_name_tracks(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_joints(["right_track", "swing"], [0.4, 0.2], None, 0.0)
    assert tracks(arbiter, 0.0) == [0.0, 0.4]
    assert joints(arbiter, 0.0) == [0.2, 0.0, 0.0, 0.0]


def test_twist_is_split_onto_the_tracks(make_arbiter, spec):
    arbiter = make_arbiter()
    arbiter.receive_twist(0.5, 0.0, 0.0)
    assert tracks(arbiter, 0.0) == [0.5, 0.5]
    arbiter.receive_twist(0.5, 0.2, 0.0)
    half = 0.5 * spec.tracks.gauge
    assert tracks(arbiter, 0.0) == pytest.approx([0.5 - 0.2 * half, 0.5 + 0.2 * half])
    assert arbiter.command_at(0.0, HOME).track_sources == ("twist",) * 2


def test_limited_twist_keeps_its_curve_radius(make_arbiter, spec):
    arbiter = make_arbiter()
    arbiter.receive_twist(1.5, 0.6, 0.0)
    left, right = tracks(arbiter, 0.0)
    assert right == pytest.approx(spec.tracks.max_speed)
    commanded_curvature = 0.6 / 1.5
    curvature = ((right - left) / spec.tracks.gauge) / (0.5 * (left + right))
    assert curvature == pytest.approx(commanded_curvature)


def test_velocity_above_the_maximum_is_accepted(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([5.0, -3.0, 0.0, 0.0], 0.0)
    assert joints(arbiter, 0.0) == [5.0, -3.0, 0.0, 0.0]


def test_emergency_stop_overrides_all_commands_until_released(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1] * 4, 0.0)
    arbiter.emergency_stop(True)
    arbiter.receive_tracks([1.0, 1.0], 0.0)
    applied = arbiter.command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.0] * 4
    assert applied.tracks.tolist() == [0.0] * 2
    assert applied.joint_sources == ("emergency_stop",) * 4
    assert applied.track_sources == ("emergency_stop",) * 2
    assert arbiter.is_stopped


def test_only_new_commands_apply_after_the_release(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1] * 4, 0.0)
    arbiter.emergency_stop(True)
    arbiter.receive_tracks([1.0, 1.0], 0.01)
    arbiter.emergency_stop(False)
    assert joints(arbiter, 0.02) == [0.0] * 4
    assert tracks(arbiter, 0.02) == [0.0] * 2
    arbiter.receive_front([0.2] * 4, 0.03)
    assert joints(arbiter, 0.03) == [0.2] * 4


def test_stop_and_release_between_two_ticks_clears_commands(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1] * 4, 0.0)
    arbiter.emergency_stop(True)
    arbiter.emergency_stop(False)
    assert joints(arbiter, 0.01) == [0.0] * 4


def test_repeated_release_changes_nothing(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1] * 4, 0.0)
    arbiter.emergency_stop(False)
    assert joints(arbiter, 0.01) == [0.1] * 4


def test_invalid_command_is_rejected_under_an_emergency_stop(make_arbiter):
    arbiter = make_arbiter()
    arbiter.emergency_stop(True)
    with pytest.raises(CommandError, match="2 values"):
        arbiter.receive_front([0.1, 0.2], 0.0)


def test_clock_reset_drops_commands_with_later_arrival(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1] * 4, 100.0)
    arbiter.command_at(100.0, HOME)
    assert joints(arbiter, 0.0) == [0.0] * 4
    assert joints(arbiter, 100.0) == [0.0] * 4, (
        "it does not come back when the clock gets there again"
    )


def test_command_after_a_clock_reset_applies(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1] * 4, 0.2)
    arbiter.command_at(0.2, HOME)
    arbiter.receive_tracks([1.0, 1.0], 0.0)
    assert joints(arbiter, 0.0) == [0.0] * 4
    assert tracks(arbiter, 0.01) == [1.0, 1.0]


def test_command_that_arrives_just_after_its_tick_began_applies(make_arbiter):
    arbiter = make_arbiter()
    arbiter.command_at(0.99, HOME)
    arbiter.receive_front([0.1] * 4, 1.002)
    assert joints(arbiter, 1.0) == [0.1] * 4


def test_reset_drops_all_but_the_emergency_stop(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.1] * 4, 0.0)
    arbiter.reset()
    assert arbiter.command_at(0.0, HOME).joint_sources == NONE
    arbiter.emergency_stop(True)
    arbiter.reset()
    assert arbiter.is_stopped


def test_delayed_commands_take_effect_in_the_order_of_their_times(make_arbiter):
    arbiter = make_arbiter()
    for velocity, effect_time in ((0.3, 0.03), (0.2, 0.02), (0.1, None)):
        arbiter.receive_joints(["boom"], [velocity], [], 0.0, effect_time=effect_time)
    arbiter.receive_twist(0.5, 0.0, 0.0, effect_time=0.03)
    assert [joints(arbiter, t)[1] for t in (0.0, 0.01, 0.02, 0.03)] == [0.1, 0.1, 0.2, 0.3]
    assert tracks(arbiter, 0.03) == [0.5, 0.5]
    assert joints(arbiter, 0.32)[1] == 0.3, "it times out after its effect, not its arrival"
    for velocity, effect_time in ((0.3, 0.43), (0.2, 0.42)):
        arbiter.receive_joints(["boom"], [velocity], [], 0.4, effect_time=effect_time)
    assert joints(arbiter, 0.43)[1] == 0.3, "both are due"


def test_repeated_command_lasts_no_longer_and_replaces_no_newer_one(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_twist(0.5, 0.0, 0.0, effect_time=0.0)
    arbiter.receive_joints(["boom"], [0.2], [], 0.1, effect_time=0.1)
    arbiter.receive_twist(0.5, 0.0, 0.1, effect_time=0.0)
    arbiter.receive_joints(["boom"], [0.1], [], 0.1, effect_time=0.0)
    assert [tracks(arbiter, t) for t in (0.3, 0.31)] == [[0.5, 0.5], [0.0, 0.0]]
    assert joints(arbiter, 0.31)[1] == 0.2


@pytest.mark.parametrize("end", ["reset", "stop"])
def test_reset_and_emergency_stop_drop_delayed_commands(make_arbiter, end):
    arbiter = make_arbiter()
    arbiter.receive_joints(["boom"], [0.1], [], 0.0, effect_time=0.02)
    if end == "reset":
        arbiter.reset()
    else:
        arbiter.emergency_stop(True)
        arbiter.emergency_stop(False)
    assert joints(arbiter, 0.02)[1] == 0.0


def test_restored_arbiter_continues_with_what_was_received(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_joy([0.0] * 6, [], 0.0)
    arbiter.receive_joy([0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [], 0.0)  # a lever is deflected
    arbiter.emergency_stop(True)
    arbiter.emergency_stop(False)
    arbiter.receive_tracks([0.5, 0.5], 0.0)
    arbiter.receive_joints(["boom"], [0.1], [], 0.0, effect_time=0.02)
    other = make_arbiter()
    other.restore(pickle.loads(pickle.dumps(arbiter.state)))
    other.receive_joy([0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [], 0.01)
    assert tracks(other, 0.01) == [0.5, 0.5]
    assert joints(other, 0.01) == [0.0] * 4, "the lever was not released since the stop"
    assert joints(other, 0.02)[1] == 0.1


def test_position_command_reaches_and_holds_its_target(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_joints(["boom", "bucket"], [], [0.0, 1.9], 0.0)
    applied = arbiter.command_at(0.0, HOME)
    assert applied.joints[1] > 0.0
    assert applied.joints[3] == 0.0
    assert applied.joint_sources == ("none", "joints", "none", "joints")


def test_position_command_must_be_renewed(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_joints(["boom"], [], [0.0], 0.0)
    assert joints(arbiter, 0.31) == [0.0] * 4


def test_applied_command_is_read_only(make_arbiter):
    applied = make_arbiter().command_at(0.0, HOME)
    with pytest.raises(ValueError, match="read-only"):
        applied.joints[0] = 1.0


@pytest.mark.parametrize("positions", [(0.0,), (0.0, np.nan, 0.0, 0.0), None])
def test_joint_positions_must_cover_all_joints(make_arbiter, positions):
    with pytest.raises(CommandError, match="joint_positions"):
        make_arbiter().command_at(0.0, positions)


def test_import_loads_no_physics_engine():
    code = "import sys, machine_sim.commands; sys.exit('pybullet' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
