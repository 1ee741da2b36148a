"""Pose of a machine and the soil's reaction on it: odometry, transforms, wrench.

All poses are ground truth in the frame `map`. There is no drift, so there is no `odom` frame
between `map` and the base, and the odometry is in `map` with zero covariance.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Transform,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    Vector3,
    Wrench,
    WrenchStamped,
)
from nav_msgs.msg import Odometry
from numpy.typing import ArrayLike, NDArray
from std_msgs.msg import Header

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.machine_state import BasePose, BaseState
from msg_bridge.codec.rotations import rotation_matrix, unit_quaternion
from msg_bridge.contract.errors import ErrorCode

__all__ = [
    "ToolWrench",
    "from_odometry",
    "odometry_round_trip",
    "pose_round_trip",
    "to_odometry",
    "to_tf_message",
    "to_transforms",
    "to_wrench",
]

Array = NDArray[np.float64]


class ToolWrench(NamedTuple):
    """The soil's reaction at a tool, map frame.

    Attributes:
        force: [N], shape (3,).
        torque: about the tool frame's origin [N m], shape (3,).
        rotation: rotation matrix, tool to map, shape (3, 3).
    """

    force: ArrayLike
    torque: ArrayLike
    rotation: ArrayLike


def to_odometry(
    base: BaseState, child_frame_id: str, stamp: Time, *, frame_id: str = "map"
) -> Odometry:
    """Encode the pose of the base in `frame_id` and, as in nav_msgs, its twist in `child_frame_id`.

    Args:
        base: pose and twist, both in the map frame.
        child_frame_id: frame of the base, prefix included.
        stamp: end of the tick of the state.
        frame_id: name of the map frame.

    Raises:
        CodecError: SHAPE, or VALUE of the quaternion.
    """
    position, (qx, qy, qz, qw), linear, angular = _to_base_frame(base)
    x, y, z = position.tolist()
    pose = Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
    return Odometry(
        header=Header(stamp=stamp, frame_id=frame_id),
        child_frame_id=child_frame_id,
        pose=PoseWithCovariance(pose=pose),
        twist=TwistWithCovariance(twist=Twist(linear=_vector3(linear), angular=_vector3(angular))),
    )


def from_odometry(msg: Odometry, *, frame_id: str = "map") -> BaseState:
    """Decode pose and twist of a base, both in the map frame; the inverse of `to_odometry`.

    Raises:
        CodecError: FRAME: of another frame; VALUE: not finite, or not a rotation.
    """
    if msg.header.frame_id != frame_id:
        raise CodecError(
            f"the odometry is in {msg.header.frame_id!r}; give it in {frame_id!r}", ErrorCode.FRAME
        )
    pose, twist = msg.pose.pose, msg.twist.twist
    q = pose.orientation
    position, linear, angular = (
        np.array([v.x, v.y, v.z]) for v in (pose.position, twist.linear, twist.angular)
    )
    return _to_map_frame(position, (q.x, q.y, q.z, q.w), linear, angular)


def odometry_round_trip(base: BaseState) -> BaseState:
    """Return `from_odometry(to_odometry(base, ...))`, computed without a message.

    Raises:
        CodecError: SHAPE or VALUE.
    """
    return _to_map_frame(*_to_base_frame(base))


def pose_round_trip(position: ArrayLike, quaternion: ArrayLike) -> BasePose:
    """Return the pose of `odometry_round_trip` for a base with this pose, without its velocities.

    Raises:
        CodecError: SHAPE or VALUE.
    """
    origin = _vector(position, "base position")
    # Once where the message is encoded, once where it is decoded.
    turn = unit_quaternion(unit_quaternion(quaternion))
    _check_finite(origin.tolist())
    return BasePose(origin, np.array(turn))


def to_transforms(
    child_frame_ids: Sequence[str],
    positions: ArrayLike,
    quaternions: ArrayLike,
    stamp: Time,
    *,
    frame_id: str = "map",
) -> list[TransformStamped]:
    """Encode the transforms from the map to each link.

    Args:
        child_frame_ids: frames of the links, prefix included.
        positions: positions of their origins [m], map frame, shape (n, 3).
        quaternions: orientations, link to map, x, y, z, w, shape (n, 4).
        stamp: end of the tick.
        frame_id: name of the map frame.

    Raises:
        CodecError: SHAPE, or VALUE of a quaternion.
    """
    origin, quaternion = np.asarray(positions, np.float64), np.asarray(quaternions, np.float64)
    count = len(child_frame_ids)
    if origin.shape != (count, 3) or quaternion.shape != (count, 4):
        raise CodecError(
            f"positions have shape {origin.shape} and quaternions {quaternion.shape}; give one for"
            f" each of {count} frames",
            ErrorCode.SHAPE,
        )
    header = Header(stamp=stamp, frame_id=frame_id)
    return [
        TransformStamped(
            header=header,
            child_frame_id=child,
            transform=Transform(translation=_vector3(p), rotation=_quaternion(q)),
        )
        for child, p, q in zip(child_frame_ids, origin, quaternion, strict=True)
    ]


def to_tf_message(transforms: Sequence[TransformStamped]) -> Any:
    """Return a tf2_msgs/TFMessage of transforms for `/tf`; None if tf2_msgs is not installed."""
    try:
        messages = importlib.import_module("tf2_msgs.msg")
    except ImportError:
        return None
    return messages.TFMessage(transforms=list(transforms))


def to_wrench(
    force: ArrayLike, torque: ArrayLike, rotation: ArrayLike, frame_id: str, stamp: Time
) -> WrenchStamped:
    """Encode the reaction of the soil at the tool, in the tool frame.

    Args:
        force: of the soil on the tool [N], map frame, shape (3,).
        torque: about the tool frame's origin [N m], map frame, shape (3,).
        rotation: rotation matrix, tool to map, shape (3, 3).
        frame_id: the tool frame, prefix included.
        stamp: end of the tick it acted in.

    Raises:
        CodecError: an array of another shape.
    """
    matrix = np.asarray(rotation, np.float64)
    if matrix.shape != (3, 3):
        raise CodecError(
            f"the tool's rotation has shape {matrix.shape}; give a (3, 3) matrix", ErrorCode.SHAPE
        )
    return WrenchStamped(
        header=Header(stamp=stamp, frame_id=frame_id),
        wrench=Wrench(
            force=_vector3(matrix.T @ _vector(force, "force")),
            torque=_vector3(matrix.T @ _vector(torque, "torque")),
        ),
    )


def _to_base_frame(
    base: BaseState,
) -> tuple[Array, tuple[float, float, float, float], Array, Array]:
    """Return position and unit quaternion, map frame; velocity and angular velocity, base frame."""
    map_to_base = rotation_matrix(base.quaternion).T
    return (
        _vector(base.position, "base position"),
        unit_quaternion(base.quaternion),
        map_to_base.dot(_vector(base.velocity, "base velocity")),
        map_to_base.dot(_vector(base.angular_velocity, "base angular velocity")),
    )


def _to_map_frame(
    position: Array, quaternion: tuple[float, float, float, float], linear: Array, angular: Array
) -> BaseState:
    """Return pose and twist in the map frame; the inverse of `_to_base_frame`.

    Raises:
        CodecError: VALUE: not finite, or not a rotation.
    """
    quaternion = unit_quaternion(quaternion)
    base_to_map = rotation_matrix(quaternion)
    velocity, angular_velocity = base_to_map.dot(linear), base_to_map.dot(angular)
    _check_finite([*position.tolist(), *velocity.tolist(), *angular_velocity.tolist()])
    return BaseState(position, np.array(quaternion), velocity, angular_velocity)


def _check_finite(values: list[float]) -> None:
    if not all(map(math.isfinite, values)):
        raise CodecError("the odometry has values that are not finite", ErrorCode.VALUE)


def _vector(values: ArrayLike, what: str) -> Array:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (3,):
        raise CodecError(f"{what} has shape {vector.shape}; give 3 numbers", ErrorCode.SHAPE)
    return vector


def _vector3(vector: Array) -> Vector3:
    x, y, z = vector.tolist()
    return Vector3(x=x, y=y, z=z)


def _quaternion(quaternion: ArrayLike) -> Quaternion:
    x, y, z, w = unit_quaternion(quaternion)
    return Quaternion(x=x, y=y, z=z, w=w)
