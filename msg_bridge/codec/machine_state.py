"""A machine's joints, commands, payload, cylinders and tracks as messages.

The joint states contain the pose of the base, too, as the values of joints that a URDF may put
between `map` and the base: the prismatic `base_x`, `base_y`, `base_z` [m], then `base_yaw`,
`base_pitch`, `base_roll` [rad]. With such a URDF robot_state_publisher publishes the complete tree.
"""

from __future__ import annotations

import array
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.labelled_array import from_labelled_array, to_labelled_array
from msg_bridge.codec.rotations import rotation_matrix, yaw_pitch_roll
from msg_bridge.contract.cylinder_state import CylinderState
from msg_bridge.contract.errors import ErrorCode

__all__ = [
    "BASE_JOINTS",
    "BasePose",
    "BaseState",
    "JointValues",
    "PayloadState",
    "TrackValues",
    "from_command_state",
    "from_cylinder_array",
    "from_payload_array",
    "from_track_array",
    "to_command_state",
    "to_cylinder_array",
    "to_joint_state",
    "to_payload_array",
    "to_track_array",
]

Array = NDArray[np.float64]

BASE_JOINTS = ("base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll")
"""The virtual joints from `map` to the base, in order."""

_CYLINDER_FIELDS = ("length_m", "speed_m_s", "force_n", "cap_pa", "rod_pa")

_MIN_COS_PITCH = 1e-9
"""Cosine of the pitch below which yaw and roll count as rotations about the same axis."""


class BasePose(NamedTuple):
    """Pose of `base_link`, map frame: the first part of `BaseState`."""

    position: ArrayLike
    quaternion: ArrayLike


class BaseState(NamedTuple):
    """Pose and twist of `base_link`, map frame.

    Attributes:
        position: position of its origin [m], shape (3,).
        quaternion: orientation, base to map, x, y, z, w.
        velocity: velocity of its origin [m/s], shape (3,).
        angular_velocity: [rad/s], shape (3,).
    """

    position: ArrayLike
    quaternion: ArrayLike
    velocity: ArrayLike
    angular_velocity: ArrayLike


class JointValues(NamedTuple):
    """Names, positions [rad] or [m], velocities and efforts [N m] or [N] of joints, shape (n,)."""

    names: Sequence[str]
    positions: ArrayLike
    velocities: ArrayLike
    efforts: ArrayLike


class PayloadState(NamedTuple):
    """Soil in a machine's tools. The fields are the labels of the array message, in order.

    Attributes:
        bank_m3, loose_m3: bank and loose volume of the soil in the tools [m^3].
        mass_kg: mass of the soil [kg].
        fill: loose volume as a fraction of the heaped capacity, of the fullest tool.
        time_s: simulation time of the state [s]; an array message has no stamp.
    """

    bank_m3: float
    loose_m3: float
    mass_kg: float
    fill: float
    time_s: float = 0.0


class TrackValues(NamedTuple):
    """State of one track. The fields are the labels of the array message, in order.

    Attributes:
        slip: difference between the speeds of belt and ground as a fraction of the larger one,
            averaged over half a second: 1 for a track that spins on the spot, -1 for a locked one
            that is dragged.
        sinkage_m: mean depth of the soles below the undisturbed ground [m].
        speed_m_s: speed of the belt relative to the machine [m/s].
        drive_force_n: force of the drive on the belt [N], positive forward.
    """

    slip: float
    sinkage_m: float
    speed_m_s: float
    drive_force_n: float


_PAYLOAD_LABEL = ",".join(PayloadState._fields)

_TRACK_LABEL = ",".join(
    [*(f"{side}_{field}" for side in ("left", "right") for field in TrackValues._fields), "time_s"]
)


def to_joint_state(joints: JointValues, base: BaseState, stamp: Time) -> JointState:
    """Encode the state of all joints, the virtual ones of the base included (effort 0).

    At a pitch of 90 degrees the rates of yaw and roll are undefined; the roll rate is 0 then.

    Args:
        joints: the joints of the machine.
        base: pose and twist of the base.
        stamp: end of the tick of the state.

    Raises:
        CodecError: SHAPE: other than one value for each name; VALUE: an invalid quaternion.
    """
    values_by_kind = [
        _to_double_array(values, len(joints.names), what)
        for values, what in (
            (joints.positions, "joint positions"),
            (joints.velocities, "joint velocities"),
            (joints.efforts, "joint efforts"),
        )
    ]
    position = _to_double_array(base.position, 3, "base position")
    velocity = _to_double_array(base.velocity, 3, "base velocity")
    angles = yaw_pitch_roll(rotation_matrix(base.quaternion))
    angular_velocity = _to_double_array(base.angular_velocity, 3, "base angular velocity")
    values_by_kind[0].extend([*position, *angles])
    values_by_kind[1].extend([*velocity, *_angle_rates(angles, angular_velocity)])
    values_by_kind[2].extend([0.0] * len(BASE_JOINTS))
    return JointState(
        header=Header(stamp=stamp),
        name=[*joints.names, *BASE_JOINTS],
        position=values_by_kind[0],
        velocity=values_by_kind[1],
        effort=values_by_kind[2],
    )


def to_command_state(names: Sequence[str], velocities: ArrayLike, stamp: Time) -> JointState:
    """Encode the command that takes effect in a tick.

    Args:
        names: joints and tracks.
        velocities: [rad/s] or [m/s], in the order of `names`, shape (n,); transmitted exactly.
        stamp: end of the tick.

    Raises:
        CodecError: SHAPE: other than one value for each name; VALUE: not finite.
    """
    values = _to_double_array(velocities, len(names), "commanded velocities")
    _check_finite(names, values)
    return JointState(header=Header(stamp=stamp), name=list(names), velocity=values)


def from_command_state(msg: JointState, names: Sequence[str]) -> Array:
    """Decode the velocities of a command, in the order of `names`, shape (len(names),).

    Raises:
        CodecError: LABELS: other names or another order; LAYOUT: other than one velocity for each,
            or positions or efforts; VALUE: not finite.
    """
    if list(msg.name) != list(names):
        raise CodecError(
            f"the command names [{', '.join(msg.name)}]; give {', '.join(names)}, in this order",
            ErrorCode.LABELS,
        )
    if len(msg.position) or len(msg.effort):
        raise CodecError(
            "an applied command has velocities only; leave position and effort empty",
            ErrorCode.LAYOUT,
        )
    if len(msg.velocity) != len(names):
        raise CodecError(
            f"the command has {len(msg.velocity)} velocities for {len(names)} names",
            ErrorCode.LAYOUT,
        )
    _check_finite(names, msg.velocity)
    return np.array(msg.velocity, dtype=np.float64)


def to_payload_array(payload: PayloadState) -> Float64MultiArray:
    """Encode a payload; the label names each value with its unit."""
    return to_labelled_array(_PAYLOAD_LABEL, payload)


def from_payload_array(msg: Float64MultiArray) -> PayloadState:
    """Decode a payload.

    Raises:
        CodecError: LAYOUT or LABELS.
    """
    return PayloadState(*from_labelled_array(msg, _PAYLOAD_LABEL, "a payload"))


def to_cylinder_array(cylinders: Mapping[str, CylinderState], time: float) -> Float64MultiArray:
    """Encode cylinders; the label names each value with its unit.

    Args:
        cylinders: states by joint.
        time: simulation time of the states [s]; an array message has no stamp.
    """
    values = [value for cylinder in cylinders.values() for value in cylinder]
    return to_labelled_array(_cylinder_label(list(cylinders)), [*values, time])


def from_cylinder_array(
    msg: Float64MultiArray, joints: Sequence[str]
) -> tuple[dict[str, CylinderState], float]:
    """Decode the cylinders of some joints, by joint, and the simulation time of their state [s].

    Raises:
        CodecError: LAYOUT or LABELS.
    """
    *values, time = from_labelled_array(msg, _cylinder_label(joints), "cylinders")
    size = len(CylinderState._fields)
    return {
        joint: CylinderState(*values[k * size : (k + 1) * size]) for k, joint in enumerate(joints)
    }, time


def to_track_array(left: TrackValues, right: TrackValues, time: float) -> Float64MultiArray:
    """Encode both tracks; the label names each value with its unit.

    Args:
        left, right: states of the tracks.
        time: simulation time of the states [s]; an array message has no stamp.
    """
    return to_labelled_array(_TRACK_LABEL, [*left, *right, time])


def from_track_array(msg: Float64MultiArray) -> tuple[TrackValues, TrackValues, float]:
    """Decode the left and the right track, and the simulation time of their state [s].

    Raises:
        CodecError: LAYOUT or LABELS.
    """
    *values, time = from_labelled_array(msg, _TRACK_LABEL, "tracks")
    size = len(TrackValues._fields)
    return TrackValues(*values[:size]), TrackValues(*values[size:]), time


def _cylinder_label(joints: Sequence[str]) -> str:
    return ",".join(
        [*(f"{joint}_{field}" for joint in joints for field in _CYLINDER_FIELDS), "time_s"]
    )


def _angle_rates(
    angles: tuple[float, float, float], angular_velocity: Sequence[float]
) -> tuple[float, float, float]:
    """Return the rates of yaw, pitch, roll [rad/s] at an angular velocity [rad/s], map frame."""
    yaw, pitch, _ = angles
    s, c = math.sin(yaw), math.cos(yaw)
    # In the frame after the yaw, the axis of the roll is (cos pitch, 0, -sin pitch).
    x, y = (
        c * angular_velocity[0] + s * angular_velocity[1],
        c * angular_velocity[1] - s * angular_velocity[0],
    )
    cos_pitch = math.cos(pitch)
    roll = x / cos_pitch if abs(cos_pitch) > _MIN_COS_PITCH else 0.0
    return angular_velocity[2] + math.sin(pitch) * roll, y, roll


def _to_double_array(values: ArrayLike, count: int, what: str) -> array.array[float]:
    """Return values in the type that a message keeps without a copy."""
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (count,):
        raise CodecError(f"{what} have shape {vector.shape}; give {count} numbers", ErrorCode.SHAPE)
    return array.array("d", vector.tolist())


def _check_finite(names: Sequence[str], velocities: Sequence[float]) -> None:
    for name, velocity in zip(names, velocities, strict=True):
        if not math.isfinite(velocity):
            raise CodecError(
                f"the velocity of {name} is {velocity}; give a finite number", ErrorCode.VALUE
            )
