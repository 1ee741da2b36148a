"""Closed-form kinematics: inverse against forward kinematics, frames, and reach."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from machine_sim.machine import (
    EXCAVATOR_JOINTS,
    ReachError,
    load_machine_spec,
    map_to_swing_frame,
    rotation_matrix,
    solve_arm_angles,
    swing_angle_toward,
    swing_frame_to_map,
    tool_point,
    tool_pose,
)
from machine_sim.machine.arm_kernels import remainder
from machine_sim.machine.arm_kinematics import arm_geometry, solve_bucket_pin_angles
from msg_bridge.kernels import kernel

from .conftest import MACHINE_FILE

MACHINE = load_machine_spec(MACHINE_FILE)
LIMITS = [MACHINE.joints[name] for name in EXCAVATOR_JOINTS[1:]]
ANGLES = st.tuples(*(st.floats(limit.lower, limit.upper) for limit in LIMITS))
QUATERNIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)

CARRY = (-0.70, 1.60, 2.17)
DUMP = (-0.60, 1.20, -0.60)


@settings(max_examples=300, deadline=None)
@given(ANGLES)
def test_inverse_kinematics_inverts_tool_point(angles):
    np.testing.assert_allclose(
        solve_arm_angles(MACHINE, *tool_point(MACHINE, *angles)), angles, atol=1e-9
    )


@settings(max_examples=100, deadline=None)
@given(ANGLES)
def test_bucket_pin_angles_invert_the_tool_pose(angles):
    _, origin = tool_pose(MACHINE, np.zeros(3), np.eye(3), [0.0, *angles])
    pin = origin - arm_geometry(MACHINE).swing
    np.testing.assert_allclose(
        solve_bucket_pin_angles(MACHINE, pin[0], pin[2]), angles[:2], atol=1e-9
    )


@settings(max_examples=100, deadline=None)
@given(ANGLES, QUATERNIONS, st.floats(-10.0, 10.0))
def test_lip_of_the_tool_pose_is_in_the_arm_plane(angles, quaternion, swing):
    rotation = rotation_matrix(np.array(quaternion) / np.linalg.norm(quaternion))
    base = np.array([3.0, -2.0, 1.0])
    tool, origin = tool_pose(MACHINE, base, rotation, [swing, *angles])
    lip = origin + tool @ [MACHINE.bucket.tip_radius, 0.0, 0.0]
    reach, lateral, height = map_to_swing_frame(MACHINE, base, rotation, swing, lip)
    tip = tool_point(MACHINE, *angles)
    assert (reach, lateral, height) == pytest.approx((tip.reach, 0.0, tip.height), abs=1e-9)
    back = swing_frame_to_map(MACHINE, base, rotation, swing, [reach, lateral, height])
    np.testing.assert_allclose(back, lip, atol=1e-9)


def test_swing_angle_toward_a_point_puts_it_into_the_arm_plane():
    rotation = rotation_matrix([0.1, -0.05, 0.3, math.sqrt(1 - 0.1025)])
    base, point = np.array([1.0, 2.0, 0.5]), np.array([-6.0, 5.0, 0.2])
    swing = swing_angle_toward(MACHINE, base, rotation, point)
    reach, lateral, _ = map_to_swing_frame(MACHINE, base, rotation, swing, point)
    assert lateral == pytest.approx(0.0, abs=1e-12)
    assert reach > 0.0


def test_positive_angles_lower_the_arm_and_curl_the_bucket_in():
    boom, arm, bucket = -0.5, 1.0, 0.5
    before = tool_point(MACHINE, boom, arm, bucket)
    assert tool_point(MACHINE, boom + 0.1, arm, bucket).height < before.height
    assert tool_point(MACHINE, boom, arm, bucket + 0.1).reach < before.reach


@pytest.mark.parametrize(("pose", "sign"), [(CARRY, 1), (DUMP, -1)])
def test_opening_points_up_to_carry_and_down_to_dump(pose, sign):
    rotation, _ = tool_pose(MACHINE, np.zeros(3), np.eye(3), [0.4, *pose])
    assert sign * (rotation @ MACHINE.bucket.opening_normal)[2] > 0.95


def test_opening_points_toward_the_machine_to_dig():
    angles = solve_arm_angles(MACHINE, 8.0, -arm_geometry(MACHINE).swing[2] - 0.1, 1.85)
    rotation, _ = tool_pose(MACHINE, np.zeros(3), np.eye(3), [0.0, *angles])
    assert (rotation @ MACHINE.bucket.opening_normal)[0] < -0.9


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ((12.0, 0.0, 1.5), "arm reaches"),
        ((2.0, 6.05, 1.57), "boom would be at"),
        ((7.5, 2.5, 0.1), "bucket would be at"),
        ((math.nan, 0.0, 0.0), "finite"),
    ],
)
def test_poses_out_of_reach_are_rejected(target, message):
    with pytest.raises(ReachError, match=message):
        solve_arm_angles(MACHINE, *target)


@kernel
def _remainder(x, y):  # type: ignore[no-untyped-def]
    return remainder(x, y)


@given(st.floats(-100.0, 100.0))
def test_remainder_in_kernels_has_the_bits_of_that_in_python(angle):
    turn = 2.0 * math.pi
    for x in (angle, 0.5 * turn, 1.5 * turn, -0.5 * turn, turn, math.pi * round(angle)):
        assert _remainder(x, turn).hex() == math.remainder(x, turn).hex()
