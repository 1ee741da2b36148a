"""The arm as its operator thinks of it: places of the bucket over the map, and back."""

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


def opening_normal(seen, joints):
    rotation, _ = tool_pose(MACHINE, seen.base_position, seen.base_rotation, joints)
    return rotation @ MACHINE.bucket.opening_normal


def farthest(seen, place):
    """Largest radius [m] at which the pin of a place can be, without pulling it in."""
    radius = 4.0
    while True:
        try:
            joints = ARM.joint_angles(seen, place._replace(radius=radius + 0.01))
        except ReachError:
            return radius
        if ARM.bucket_pose(observation(joints)).radius < radius + 0.005:
            return radius
        radius += 0.01


@settings(max_examples=300, deadline=None)
@given(JOINTS, BASES)
def test_joints_of_the_place_of_the_bucket_are_those_it_has(joints, rotation):
    seen = observation(joints, position=(1.0, -2.0, 0.5), rotation=rotation)
    np.testing.assert_allclose(ARM.joint_angles(seen, ARM.bucket_pose(seen)), joints, atol=1e-6)


@settings(max_examples=200, deadline=None)
@given(
    BASES,
    st.floats(-3.1, 3.1),
    st.floats(4.5, 6.0),
    st.floats(0.0, 2.0),
    st.floats(1.9, 3.1),
)
def test_bucket_is_where_it_was_to_be_put(rotation, azimuth, radius, height, attitude):
    place = BucketPose(azimuth, radius, height, attitude)
    base = {"position": (3.0, 1.0, 0.2), "rotation": rotation}
    found = ARM.bucket_pose(observation(ARM.joint_angles(observation(**base), place), **base))
    assert math.remainder(found.azimuth - azimuth, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert found[1:3] == pytest.approx(place[1:3], abs=1e-9)


def test_place_is_told_over_the_map_and_not_over_the_base():
    seen = observation([0.3, -0.5, 1.5, 1.5], position=(4.0, -1.0, 2.0), rotation=tilted(yaw=0.9))
    _, pin = tool_pose(MACHINE, seen.base_position, seen.base_rotation, seen.joints)
    place = ARM.bucket_pose(seen)
    assert place.azimuth == pytest.approx(1.2)
    assert place.height == pytest.approx(pin[2])
    assert place.radius == pytest.approx(math.hypot(pin[0] - 4.0, pin[1] + 1.0))
    assert place.attitude == pytest.approx(2.5)


@pytest.mark.parametrize("pitch", [-0.15, 0.0, 0.15])
def test_level_bucket_has_its_mouth_up_also_on_a_slope(pitch):
    seen = observation(rotation=tilted(pitch=pitch))
    joints = ARM.joint_angles(seen, WORKING._replace(azimuth=0.0, attitude=ARM.level_attitude))
    np.testing.assert_allclose(opening_normal(seen, joints), [0.0, 0.0, 1.0], atol=1e-9)


def test_level_bucket_reaches_as_deep_below_its_pin_as_told():
    joints = ARM.joint_angles(observation(), WORKING._replace(attitude=ARM.level_attitude))
    rotation, pin = tool_pose(MACHINE, np.zeros(3), np.eye(3), joints)
    lowest = (MACHINE.bucket.key_points @ rotation.T + pin)[:, 2].min()
    assert WORKING.height - lowest == pytest.approx(ARM.depth_below_pin)


@pytest.mark.parametrize("angle", [-0.35, 0.0, 0.45])
def test_floor_behind_the_lip_slants_by_the_angle_of_attack(angle):
    joints = ARM.joint_angles(
        observation(), WORKING._replace(azimuth=0.0, attitude=ARM.attitude_for_attack_angle(angle))
    )
    rotation, _ = tool_pose(MACHINE, np.zeros(3), np.eye(3), joints)
    (lip_x, lip_z), (floor_x, floor_z) = MACHINE.bucket.profile[:2]
    ahead = rotation @ [lip_x - floor_x, 0.0, lip_z - floor_z]
    assert math.atan2(-ahead[2], -ahead[0]) == pytest.approx(angle)


def test_lip_is_where_it_was_to_be_put():
    place = ARM.pose_with_lip_at(0.7, 6.5, -0.3, 2.0)
    at = lip(observation(), ARM.joint_angles(observation(), place))
    np.testing.assert_allclose(at, [6.5 * math.cos(0.7), 6.5 * math.sin(0.7), -0.3], atol=1e-9)


def test_pin_a_little_too_far_out_is_put_nearer():
    most = farthest(observation(), WORKING)
    joints = ARM.joint_angles(observation(), WORKING._replace(radius=most + 0.25))
    found = ARM.bucket_pose(observation(joints))
    assert most - 0.1 < found.radius <= most + 0.02
    assert (found.azimuth, found.height) == pytest.approx((WORKING.azimuth, WORKING.height))


def test_pin_far_too_far_out_is_refused():
    far = farthest(observation(), WORKING) + 1.0
    with pytest.raises(ReachError, match="move the target"):
        ARM.joint_angles(observation(), WORKING._replace(radius=far))


def test_slant_beyond_the_bucket_joint_stops_at_its_limit():
    joints = ARM.joint_angles(observation(), WORKING._replace(attitude=5.5))
    assert joints[3] == MACHINE.joints["bucket"].upper
    assert ARM.bucket_pose(observation(joints))[:3] == pytest.approx(WORKING[:3])


def test_swing_takes_the_short_way():
    joints = ARM.joint_angles(observation([3.0, *MACHINE.home[1:]]), WORKING._replace(azimuth=-3.0))
    assert joints[0] == pytest.approx(2 * math.pi - 3.0)


@pytest.mark.parametrize("turns", [-2, 3])
def test_swing_keeps_the_whole_turns_it_has_made(turns):
    swing = 2 * math.pi * turns
    joints = ARM.joint_angles(
        observation([swing + 0.2, *MACHINE.home[1:]]), WORKING._replace(azimuth=-0.1)
    )
    assert joints[0] == pytest.approx(swing - 0.1)
