"""Where a machine is, and what acts on it: odometry, transforms, wrench.

All poses are the simulation's own truth in the frame `map`. There is no drift to tell, so there is
no `odom` frame between `map` and the base, and the odometry is of `map` with zero covariance.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from functools import cache
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
from msg_bridge.codec.machine_state import BaseState
from msg_bridge.codec.rotations import rotation_matrix, unit_quaternion

__all__ = [
    "ToolWrench",
    "from_odometry",
    "odometry_round_trip",
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
        rotation: tool to map, shape (3, 3).
    """

    force: ArrayLike
    torque: ArrayLike
    rotation: ArrayLike


def to_odometry(
    base: BaseState, child_frame_id: str, stamp: Time, *, frame_id: str = "map"
) -> Odometry:
    """Pose of the base in `frame_id` and, as nav_msgs has it, its twist in `child_frame_id`.

    Args:
        base: pose and motion, both in the map frame.
        child_frame_id: frame of the base, its prefix included.
        stamp: end of the tick it is the state of.
        frame_id: name of the map frame.

    Raises:
        CodecError: a vector or quaternion that is none.
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
    """Pose and motion of a base in the map frame, as arrays: `to_odometry` back.

    Raises:
        CodecError: of another frame, or numbers that are no pose and motion.
    """
    if msg.header.frame_id != frame_id:
        raise CodecError(
            f"the odometry's pose is in {msg.header.frame_id!r}; it must be in {frame_id!r}"
        )
    pose, twist = msg.pose.pose, msg.twist.twist
    turn = pose.orientation
    position, linear, angular = (
        np.array([v.x, v.y, v.z]) for v in (pose.position, twist.linear, twist.angular)
    )
    return _to_map_frame(position, (turn.x, turn.y, turn.z, turn.w), linear, angular)


def odometry_round_trip(base: BaseState) -> BaseState:
    """A base as odometry tells of it: `from_odometry(to_odometry(base, ...))`, without a message.

    Raises:
        CodecError: a vector or quaternion that is none, or numbers that are not finite.
    """
    return _to_map_frame(*_to_base_frame(base))


def to_transforms(
    child_frame_ids: Sequence[str],
    positions: ArrayLike,
    quaternions: ArrayLike,
    stamp: Time,
    *,
    frame_id: str = "map",
) -> list[TransformStamped]:
    """Transforms from the map to each link.

    Args:
        child_frame_ids: frames of the links, prefix included.
        positions: of their origins [m], map frame, shape (n, 3).
        quaternions: link to map, x, y, z, w, shape (n, 4).
        stamp: end of the tick they are of.
        frame_id: name of the map frame.

    Raises:
        CodecError: other than one pose for each frame, or a quaternion that is none.
    """
    at, turn = np.asarray(positions, np.float64), np.asarray(quaternions, np.float64)
    count = len(child_frame_ids)
    if at.shape != (count, 3) or turn.shape != (count, 4):
        raise CodecError(
            f"positions have shape {at.shape} and quaternions {turn.shape}; give one for each of"
            f" {count} frames"
        )
    header = Header(stamp=stamp, frame_id=frame_id)
    return [
        TransformStamped(
            header=header,
            child_frame_id=child,
            transform=Transform(translation=_vector3(p), rotation=_quaternion(q)),
        )
        for child, p, q in zip(child_frame_ids, at, turn, strict=True)
    ]


def to_tf_message(transforms: Sequence[TransformStamped]) -> Any:
    """A tf2_msgs/TFMessage of transforms for `/tf`; None where there is no tf2_msgs."""
    message = _tf_message()
    return None if message is None else message(transforms=list(transforms))


def to_wrench(
    force: ArrayLike, torque: ArrayLike, rotation: ArrayLike, frame_id: str, stamp: Time
) -> WrenchStamped:
    """The soil's reaction at the tool, expressed in the tool frame.

    Args:
        force: of the soil on the tool [N], map frame, shape (3,).
        torque: about the tool frame's origin [N m], map frame, shape (3,).
        rotation: tool to map, shape (3, 3).
        frame_id: the tool frame, prefix included.
        stamp: end of the tick it acted in.

    Raises:
        CodecError: an array of another shape.
    """
    turn = np.asarray(rotation, np.float64)
    if turn.shape != (3, 3):
        raise CodecError(f"the tool's rotation has shape {turn.shape}; give a (3, 3) matrix")
    return WrenchStamped(
        header=Header(stamp=stamp, frame_id=frame_id),
        wrench=Wrench(
            force=_vector3(turn.T @ _vector(force, "force")),
            torque=_vector3(turn.T @ _vector(torque, "torque")),
        ),
    )


@cache  # looking for a package that is not there takes longer than filling the message
def _tf_message() -> Any:
    try:
        return importlib.import_module("tf2_msgs.msg").TFMessage
    except ImportError:
        return None


def _to_base_frame(
    base: BaseState,
) -> tuple[Array, tuple[float, float, float, float], Array, Array]:
    """Position and unit quaternion in the map frame, velocity and spin in the base's own."""
    inward = rotation_matrix(base.quaternion).T
    return (
        _vector(base.position, "base position"),
        unit_quaternion(base.quaternion),
        inward @ _vector(base.velocity, "base velocity"),
        inward @ _vector(base.angular_velocity, "base angular velocity"),
    )


def _to_map_frame(
    position: Array, quaternion: tuple[float, float, float, float], linear: Array, angular: Array
) -> BaseState:
    """`_inward` back.

    Raises:
        CodecError: numbers that are no pose and motion.
    """
    quaternion = unit_quaternion(quaternion)
    outward = rotation_matrix(quaternion)
    velocity, angular_velocity = outward @ linear, outward @ angular
    if not all(
        map(math.isfinite, (*position.tolist(), *velocity.tolist(), *angular_velocity.tolist()))
    ):
        raise CodecError("the odometry has numbers that are not finite; its sender has failed")
    return BaseState(position, np.array(quaternion), velocity, angular_velocity)


def _vector(values: ArrayLike, what: str) -> Array:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (3,):
        raise CodecError(f"{what} has shape {vector.shape}; give 3 numbers")
    return vector


def _vector3(vector: Array) -> Vector3:
    x, y, z = vector.tolist()
    return Vector3(x=x, y=y, z=z)


def _quaternion(quaternion: ArrayLike) -> Quaternion:
    x, y, z, w = unit_quaternion(quaternion)
    return Quaternion(x=x, y=y, z=z, w=w)
