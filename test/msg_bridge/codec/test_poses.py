"""Odometry, transforms and wrench are in the frames that they state."""

import math
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from support.wire import over_the_wire, raises

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.machine_state import BaseState
from msg_bridge.codec.poses import (
    from_odometry,
    odometry_round_trip,
    pose_round_trip,
    to_odometry,
    to_tf_message,
    to_transforms,
    to_wrench,
)
from msg_bridge.contract.errors import ErrorCode

STAMP = Time(sec=3, nanosec=40_000_000)
YAW_90 = [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]  # a yaw of 90 degrees


def numbers(vector):
    return [vector.x, vector.y, vector.z]


def driving(**change):
    """Return a base that faces +y, drives toward +y and turns left."""
    parts = {
        "position": [1.0, 2.0, 3.0],
        "quaternion": YAW_90,
        "velocity": [0.0, 2.0, 0.0],
        "angular_velocity": [0.1, 0.0, 0.3],
    }
    return BaseState(**{**parts, **change})


def test_odometry_has_the_pose_in_map_and_the_twist_in_the_base():
    msg = over_the_wire(to_odometry(driving(), "digger/base_link", STAMP))
    assert (msg.header.frame_id, msg.child_frame_id) == ("map", "digger/base_link")
    assert msg.header.stamp == STAMP
    assert numbers(msg.pose.pose.position) == [1.0, 2.0, 3.0]
    assert msg.pose.pose.orientation.z == pytest.approx(math.sqrt(0.5))
    assert numbers(msg.twist.twist.linear) == pytest.approx([2.0, 0.0, 0.0], abs=1e-15)
    assert numbers(msg.twist.twist.angular) == pytest.approx([0.0, -0.1, 0.3], abs=1e-15)
    assert not msg.pose.covariance.any()
    assert not msg.twist.covariance.any()


def test_odometry_is_decoded_to_the_map_frame():
    rng = np.random.default_rng(2)
    for _ in range(20):
        place, velocity, angular_velocity = rng.normal(size=(3, 3))
        turn = rng.normal(size=4)
        turn /= np.linalg.norm(turn)
        sent = BaseState(place, turn, velocity, angular_velocity)
        back = from_odometry(over_the_wire(to_odometry(sent, "base_link", STAMP)))
        for found, given in zip(back, sent, strict=True):
            np.testing.assert_allclose(found, given, atol=1e-14)


def test_odometry_has_a_unit_quaternion():
    msg = to_odometry(driving(quaternion=np.array(YAW_90) * (1.0 + 1e-6)), "base", STAMP)
    turn = msg.pose.pose.orientation
    assert math.hypot(turn.x, turn.y, turn.z, turn.w) == pytest.approx(1.0, abs=1e-15)


def test_round_trip_without_a_message_is_bitwise_equal():
    rng = np.random.default_rng(3)
    for _ in range(50):
        base = BaseState(*(rng.normal(size=n) for n in (3, 4, 3, 3)))
        decoded = from_odometry(over_the_wire(to_odometry(base, "base_link", STAMP)))
        for part, wanted in zip(odometry_round_trip(base), decoded, strict=True):
            assert part.tobytes() == wanted.tobytes()
        pose = pose_round_trip(base.position, base.quaternion)
        for part, wanted in zip(pose, decoded[:2], strict=True):
            assert part.tobytes() == wanted.tobytes()


def test_round_trip_of_a_base_that_is_not_finite_is_rejected():
    with raises(ErrorCode.VALUE, CodecError):
        odometry_round_trip(driving(velocity=[0.0, math.nan, 0.0]))
    with raises(ErrorCode.VALUE, CodecError):
        pose_round_trip([0.0, math.nan, 0.0], YAW_90)


def test_odometry_of_another_frame_is_rejected():
    msg = to_odometry(driving(), "base_link", STAMP, frame_id="odom")
    with raises(ErrorCode.FRAME, CodecError):
        from_odometry(msg)
    assert from_odometry(msg, frame_id="odom").position[0] == 1.0


@pytest.mark.parametrize("part", ["position", "velocity", "angular_velocity"])
def test_odometry_that_is_not_finite_is_rejected(part):
    msg = to_odometry(driving(**{part: [0.0, math.nan, 0.0]}), "base_link", STAMP)
    with raises(ErrorCode.VALUE, CodecError):
        from_odometry(msg)


def test_odometry_without_an_orientation_is_rejected():
    msg = to_odometry(driving(), "base_link", STAMP)
    msg.pose.pose.orientation.z = msg.pose.pose.orientation.w = 0.0
    with raises(ErrorCode.VALUE, CodecError):
        from_odometry(msg)


def test_transforms_lead_from_map_to_each_link():
    turns = [[0.0, 0.0, 0.0, 1.0], YAW_90]
    found = to_transforms(["a/base_link", "a/upper"], [[1, 2, 3], [4, 5, 6]], turns, STAMP)
    found = [over_the_wire(msg) for msg in found]
    assert [msg.child_frame_id for msg in found] == ["a/base_link", "a/upper"]
    assert all(msg.header.frame_id == "map" and msg.header.stamp == STAMP for msg in found)
    assert [numbers(msg.transform.translation) for msg in found] == [[1, 2, 3], [4, 5, 6]]
    assert found[1].transform.rotation.z == pytest.approx(math.sqrt(0.5))
    assert found[1].transform.rotation.w == pytest.approx(math.sqrt(0.5))


def test_wrong_number_of_transforms_is_rejected():
    with raises(ErrorCode.SHAPE, CodecError):
        to_transforms(["a", "b"], [[0.0, 0.0, 0.0]], [YAW_90], STAMP)


def test_missing_tf2_msgs_gives_no_message(monkeypatch):
    monkeypatch.setitem(sys.modules, "tf2_msgs", None)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    assert to_tf_message([TransformStamped()]) is None


def test_tf_message_has_the_transforms(monkeypatch):
    messages = ModuleType("tf2_msgs.msg")
    messages.TFMessage = SimpleNamespace  # takes transforms=..., as the message does
    monkeypatch.setitem(sys.modules, "tf2_msgs", ModuleType("tf2_msgs"))
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", messages)
    sent = to_transforms(["a"], [[1.0, 2.0, 3.0]], [YAW_90], STAMP)
    assert to_tf_message(sent).transforms == sent


def test_wrench_is_expressed_in_the_tool_frame():
    # The tool's x is the map's y, its y the map's -x.
    rotation = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    force, torque = [0.0, -900.0, 50.0], [7.0, 0.0, 1.0]
    msg = over_the_wire(to_wrench(force, torque, rotation, "digger/bucket", STAMP))
    assert (msg.header.frame_id, msg.header.stamp) == ("digger/bucket", STAMP)
    assert numbers(msg.wrench.force) == [-900.0, 0.0, 50.0]
    assert numbers(msg.wrench.torque) == [0.0, -7.0, 1.0]


@pytest.mark.parametrize(
    ("force", "rotation"), [([1.0, 2.0], np.eye(3)), ([1.0, 2.0, 3.0], [0, 0, 0, 1])]
)
def test_wrench_of_other_shapes_is_rejected(force, rotation):
    with raises(ErrorCode.SHAPE, CodecError):
        to_wrench(force, [0.0, 0.0, 0.0], rotation, "bucket", STAMP)
