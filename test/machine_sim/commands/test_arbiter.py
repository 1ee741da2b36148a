"""Which command is in force: the newest, while it is renewed, and none under an emergency stop."""

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


def test_nobody_commands_at_first(arbiter):
    applied = arbiter().command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.0] * 4
    assert applied.tracks.tolist() == [0.0] * 2
    assert (applied.joint_sources, applied.track_sources) == (NONE, ("none", "none"))


def test_front_is_in_the_order_of_the_joints(arbiter, spec):
    assert tuple(spec.joints) == EXCAVATOR_JOINTS
    b = arbiter()
    b.front([0.1, 0.2, 0.3, 0.4], 0.0)
    applied = b.command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert applied.joint_sources == ("front",) * 4
    assert applied.track_sources == ("none",) * 2


def test_tracks_are_left_and_right(arbiter):
    b = arbiter()
    b.tracks(np.array([0.5, -0.5]), 0.0)
    assert tracks(b, 0.0) == [0.5, -0.5]
    assert b.command_at(0.0, HOME).track_sources == ("tracks",) * 2


def test_command_holds_until_the_timeout_and_is_zero_after(arbiter):
    b = arbiter()
    b.front([0.1, 0.0, 0.0, 0.0], 5.0)
    assert joints(b, 5.3)[0] == 0.1
    assert joints(b, 5.301)[0] == 0.0
    assert b.command_at(5.302, HOME).joint_sources == NONE


def test_command_renewed_every_timeout_never_drops_in_ticks_of_inexact_times(arbiter):
    b, seen = arbiter(), set()
    for tick in range(3000):
        if tick % 30 == 0:
            b.front([0.1, 0.0, 0.0, 0.0], tick * 0.01)
        seen.add(joints(b, tick * 0.01)[0])
    assert seen == {0.1}


def test_timeout_is_a_parameter(arbiter):
    b = arbiter(command_timeout=1.0)
    b.tracks([1.0, 1.0], 0.0)
    assert tracks(b, 0.9) == [1.0, 1.0]
    assert tracks(b, 1.1) == [0.0, 0.0]


def test_expired_command_does_not_come_back(arbiter):
    b = arbiter()
    b.front([0.1] * 4, 0.0)
    assert joints(b, 1.0) == [0.0] * 4
    assert joints(b, 1.05) == [0.0] * 4


def test_newest_command_wins_for_each_joint_it_names(arbiter):
    b = arbiter()
    b.front([0.1, 0.1, 0.1, 0.1], 0.0)
    b.joints(["arm"], [0.3], [], 0.1)
    applied = b.command_at(0.1, HOME)
    assert applied.joints.tolist() == [0.1, 0.1, 0.3, 0.1]
    assert applied.joint_sources == ("front", "front", "joints", "front")
    b.front([0.2, 0.2, 0.2, 0.2], 0.11)
    assert joints(b, 0.11) == [0.2] * 4


def test_partial_commands_of_one_source_time_out_each_for_itself(arbiter):
    b = arbiter()
    b.joints(["boom"], [0.2], [], 0.0)
    b.joints(["arm"], [0.3], [], 0.2)
    assert joints(b, 0.25) == [0.0, 0.2, 0.3, 0.0]
    assert joints(b, 0.4) == [0.0, 0.0, 0.3, 0.0]


def test_joint_command_names_tracks_too(arbiter):
    b = arbiter()
    b.joints(["right_track", "swing"], [0.4, 0.2], None, 0.0)
    assert tracks(b, 0.0) == [0.0, 0.4]
    assert joints(b, 0.0) == [0.2, 0.0, 0.0, 0.0]


def test_twist_forward_drives_both_tracks_and_left_turn_the_right_one_faster(arbiter, spec):
    b = arbiter()
    b.twist(0.5, 0.0, 0.0)
    assert tracks(b, 0.0) == [0.5, 0.5]
    b.twist(0.5, 0.2, 0.0)
    half = 0.5 * spec.tracks.gauge
    assert tracks(b, 0.0) == pytest.approx([0.5 - 0.2 * half, 0.5 + 0.2 * half])
    assert b.command_at(0.0, HOME).track_sources == ("twist",) * 2


def test_twist_too_fast_keeps_its_curve(arbiter, spec):
    b = arbiter()
    b.twist(1.5, 0.6, 0.0)
    left, right = tracks(b, 0.0)
    assert right == pytest.approx(spec.tracks.max_speed)
    told = 0.6 / 1.5
    driven = ((right - left) / spec.tracks.gauge) / (0.5 * (left + right))
    assert driven == pytest.approx(told)


def test_faster_than_the_machine_can_passes(arbiter):
    b = arbiter()
    b.front([5.0, -3.0, 0.0, 0.0], 0.0)
    assert joints(b, 0.0) == [5.0, -3.0, 0.0, 0.0]


def test_emergency_stop_beats_all_until_released(arbiter):
    b = arbiter()
    b.front([0.1] * 4, 0.0)
    b.emergency_stop(True)
    b.tracks([1.0, 1.0], 0.0)
    applied = b.command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.0] * 4
    assert applied.tracks.tolist() == [0.0] * 2
    assert applied.joint_sources == ("emergency_stop",) * 4
    assert applied.track_sources == ("emergency_stop",) * 2
    assert b.is_stopped


def test_after_the_release_only_newer_commands_move(arbiter):
    b = arbiter()
    b.front([0.1] * 4, 0.0)
    b.emergency_stop(True)
    b.tracks([1.0, 1.0], 0.01)
    b.emergency_stop(False)
    assert joints(b, 0.02) == [0.0] * 4
    assert tracks(b, 0.02) == [0.0] * 2
    b.front([0.2] * 4, 0.03)
    assert joints(b, 0.03) == [0.2] * 4


def test_stop_between_two_ticks_is_not_missed(arbiter):
    b = arbiter()
    b.front([0.1] * 4, 0.0)
    b.emergency_stop(True)
    b.emergency_stop(False)
    assert joints(b, 0.01) == [0.0] * 4


def test_release_that_is_repeated_disturbs_nothing(arbiter):
    b = arbiter()
    b.front([0.1] * 4, 0.0)
    b.emergency_stop(False)
    assert joints(b, 0.01) == [0.1] * 4


def test_bad_command_is_refused_under_an_emergency_stop_too(arbiter):
    b = arbiter()
    b.emergency_stop(True)
    with pytest.raises(CommandError, match="2 values"):
        b.front([0.1, 0.2], 0.0)


def test_clock_put_back_voids_commands_of_its_future(arbiter):
    b = arbiter()
    b.front([0.1] * 4, 100.0)
    b.command_at(100.0, HOME)
    assert joints(b, 0.0) == [0.0] * 4
    assert joints(b, 100.0) == [0.0] * 4, "it does not come back when the clock gets there again"


def test_command_that_came_after_the_clock_was_put_back_counts(arbiter):
    b = arbiter()
    b.front([0.1] * 4, 0.2)
    b.command_at(0.2, HOME)
    b.tracks([1.0, 1.0], 0.0)
    assert joints(b, 0.0) == [0.0] * 4
    assert tracks(b, 0.01) == [1.0, 1.0]


def test_command_counts_that_came_just_after_its_tick_was_due(arbiter):
    b = arbiter()
    b.command_at(0.99, HOME)
    b.front([0.1] * 4, 1.002)
    assert joints(b, 1.0) == [0.1] * 4


def test_forget_drops_all_but_the_stop(arbiter):
    b = arbiter()
    b.front([0.1] * 4, 0.0)
    b.reset()
    assert b.command_at(0.0, HOME).joint_sources == NONE
    b.emergency_stop(True)
    b.reset()
    assert b.is_stopped


def test_position_command_drives_there_and_holds(arbiter):
    b = arbiter()
    b.joints(["boom", "bucket"], [], [0.0, 1.9], 0.0)
    applied = b.command_at(0.0, HOME)
    assert applied.joints[1] > 0.0
    assert applied.joints[3] == 0.0
    assert applied.joint_sources == ("none", "joints", "none", "joints")


def test_position_command_must_be_renewed(arbiter):
    b = arbiter()
    b.joints(["boom"], [], [0.0], 0.0)
    assert joints(b, 0.31) == [0.0] * 4


def test_applied_command_cannot_be_written(arbiter):
    applied = arbiter().command_at(0.0, HOME)
    with pytest.raises(ValueError, match="read-only"):
        applied.joints[0] = 1.0


@pytest.mark.parametrize("positions", [(0.0,), (0.0, np.nan, 0.0, 0.0), None])
def test_positions_must_be_those_of_all_joints(arbiter, positions):
    with pytest.raises(CommandError, match="joint_positions"):
        arbiter().command_at(0.0, positions)


def test_commands_load_no_physics_engine():
    code = "import sys, machine_sim.commands; sys.exit('pybullet' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
