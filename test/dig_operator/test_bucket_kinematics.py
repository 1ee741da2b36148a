"""BucketKinematics: joint angles for a pose of the bucket, and back."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.operator_scenes import ARM, MACHINE, lip, observation, tilted

from dig_operator.bucket_kinematics import BucketPose
from machine_sim.machine import EXCAVATOR_JOINTS, ReachError, tool_pose

LIMITS = [MACHINE.joints[name] for name in EXCAVATOR_JOINTS[1:]]
JOINTS = st.tuples(
    st.floats(-10.0, 10.0), *(st.floats(limit.lower, limit.upper) for limit in LIMITS)
)
BASES = st.builds(
    lambda roll, pitch, yaw: tilted(roll=roll, pitch=pitch, yaw=yaw),
    st.floats(-0.3, 0.3),
    st.floats(-0.3, 0.3),
    st.floats(-3.1, 3.1),
)
WORKING = BucketPose(azimuth=0.4, radius=5.5, height=1.2, attitude=2.4)


def opening_normal(observed, joints):
    rotation, _ = tool_pose(MACHINE, observed.base_position, observed.base_rotation, joints)
    return rotation @ MACHINE.bucket.opening_normal


def max_radius(observed, pose):
    """Return the largest radius [m] at which the pin is reached without moving it inward."""
    radius = 4.0
    while True:
        try:
            joints = ARM.joint_angles(observed, pose._replace(radius=radius + 0.01))
        except ReachError:
            return radius
        if ARM.bucket_pose(observation(joints)).radius < radius + 0.005:
            return radius
        radius += 0.01


@settings(max_examples=300, deadline=None)
@given(JOINTS, BASES)
def test_joint_angles_invert_the_bucket_pose(joints, rotation):
    observed = observation(joints, position=(1.0, -2.0, 0.5), rotation=rotation)
    np.testing.assert_allclose(
        ARM.joint_angles(observed, ARM.bucket_pose(observed)), joints, atol=1e-6
    )


@settings(max_examples=200, deadline=None)
@given(
    BASES,
    st.floats(-3.1, 3.1),
    st.floats(4.5, 6.0),
    st.floats(0.0, 2.0),
    st.floats(1.9, 3.1),
)
def test_joint_angles_bring_the_bucket_to_the_pose(rotation, azimuth, radius, height, attitude):
    pose = BucketPose(azimuth, radius, height, attitude)
    base = {"position": (3.0, 1.0, 0.2), "rotation": rotation}
    reached = ARM.bucket_pose(observation(ARM.joint_angles(observation(**base), pose), **base))
    assert math.remainder(reached.azimuth - azimuth, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert reached[1:3] == pytest.approx(pose[1:3], abs=1e-9)


def test_pose_of_whole_numbers_has_the_joint_angles_of_floats():
    expected = ARM.joint_angles(observation(), BucketPose(0.0, 6.0, 1.0, 2.0))
    assert np.array_equal(ARM.joint_angles(observation(), BucketPose(0, 6, 1, 2)), expected)


def test_bucket_pose_is_in_the_map_frame():
    observed = observation(
        [0.3, -0.5, 1.5, 1.5], position=(4.0, -1.0, 2.0), rotation=tilted(yaw=0.9)
    )
    _, pin = tool_pose(MACHINE, observed.base_position, observed.base_rotation, observed.joints)
    pose = ARM.bucket_pose(observed)
    assert pose.azimuth == pytest.approx(1.2)
    assert pose.height == pytest.approx(pin[2])
    assert pose.radius == pytest.approx(math.hypot(pin[0] - 4.0, pin[1] + 1.0))
    assert pose.attitude == pytest.approx(2.5)


@pytest.mark.parametrize("pitch", [-0.15, 0.0, 0.15])
def test_level_bucket_opens_upward_on_a_slope(pitch):
    observed = observation(rotation=tilted(pitch=pitch))
    joints = ARM.joint_angles(observed, WORKING._replace(azimuth=0.0, attitude=ARM.level_attitude))
    np.testing.assert_allclose(opening_normal(observed, joints), [0.0, 0.0, 1.0], atol=1e-9)


def test_depth_below_pin_is_that_of_the_lowest_key_point_of_a_level_bucket():
    joints = ARM.joint_angles(observation(), WORKING._replace(attitude=ARM.level_attitude))
    rotation, pin = tool_pose(MACHINE, np.zeros(3), np.eye(3), joints)
    min_height = (MACHINE.bucket.key_points @ rotation.T + pin)[:, 2].min()
    assert WORKING.height - min_height == pytest.approx(ARM.depth_below_pin)


@pytest.mark.parametrize("angle", [-0.35, 0.0, 0.45])
def test_floor_behind_the_lip_is_inclined_by_the_attack_angle(angle):
    joints = ARM.joint_angles(
        observation(), WORKING._replace(azimuth=0.0, attitude=ARM.attitude_for_attack_angle(angle))
    )
    rotation, _ = tool_pose(MACHINE, np.zeros(3), np.eye(3), joints)
    (lip_x, lip_z), (floor_x, floor_z) = MACHINE.bucket.profile[:2]
    floor = rotation @ [lip_x - floor_x, 0.0, lip_z - floor_z]
    assert math.atan2(-floor[2], -floor[0]) == pytest.approx(angle)


def test_pose_with_lip_at_puts_the_lip_there():
    pose = ARM.pose_with_lip_at(0.7, 6.5, -0.3, 2.0)
    position = lip(observation(), ARM.joint_angles(observation(), pose))
    np.testing.assert_allclose(
        position, [6.5 * math.cos(0.7), 6.5 * math.sin(0.7), -0.3], atol=1e-9
    )


def test_pin_slightly_out_of_reach_is_moved_inward():
    limit = max_radius(observation(), WORKING)
    joints = ARM.joint_angles(observation(), WORKING._replace(radius=limit + 0.25))
    reached = ARM.bucket_pose(observation(joints))
    assert limit - 0.1 < reached.radius <= limit + 0.02
    assert (reached.azimuth, reached.height) == pytest.approx((WORKING.azimuth, WORKING.height))


def test_pin_far_out_of_reach_is_rejected():
    radius = max_radius(observation(), WORKING) + 1.0
    with pytest.raises(ReachError):
        ARM.joint_angles(observation(), WORKING._replace(radius=radius))


def test_attitude_beyond_the_bucket_joint_is_clamped_to_its_limit():
    joints = ARM.joint_angles(observation(), WORKING._replace(attitude=5.5))
    assert joints[3] == MACHINE.joints["bucket"].upper
    assert ARM.bucket_pose(observation(joints))[:3] == pytest.approx(WORKING[:3])


def test_swing_takes_the_shorter_direction():
    joints = ARM.joint_angles(observation([3.0, *MACHINE.home[1:]]), WORKING._replace(azimuth=-3.0))
    assert joints[0] == pytest.approx(2 * math.pi - 3.0)


@pytest.mark.parametrize("turns", [-2, 3])
def test_swing_stays_near_an_angle_of_several_turns(turns):
    swing = 2 * math.pi * turns
    joints = ARM.joint_angles(
        observation([swing + 0.2, *MACHINE.home[1:]]), WORKING._replace(azimuth=-0.1)
    )
    assert joints[0] == pytest.approx(swing - 0.1)
