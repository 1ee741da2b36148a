"""A machine's joints, commands and payload as messages.

The joint states hold the base's pose too, as the values of joints that a URDF may put between
`map` and the base: the prismatic `base_x`, `base_y`, `base_z` [m], then `base_yaw`, `base_pitch`,
`base_roll` [rad]. With such a URDF a stock robot_state_publisher gives the whole tree.
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

__all__ = [
    "BASE_JOINTS",
    "BaseState",
    "JointValues",
    "PayloadState",
    "from_command_state",
    "from_cylinder_array",
    "from_payload_array",
    "to_command_state",
    "to_cylinder_array",
    "to_joint_state",
    "to_payload_array",
]

Array = NDArray[np.float64]

BASE_JOINTS = ("base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll")
"""The joints from `map` to the base, from the map on."""

_PAYLOAD_LABEL = "bank_m3,loose_m3,mass_kg,fill,time_s"

_FIGURES = ("length_m", "speed_m_s", "force_n", "cap_pa", "rod_pa")

_MIN_COS_PITCH = 1e-9
"""Cosine of the pitch below which yaw and roll turn about the same axis."""


class BaseState(NamedTuple):
    """Where `base_link` is and how it moves, map frame.

    Attributes:
        position: of its origin [m], shape (3,).
        quaternion: base to map, x, y, z, w.
        velocity: of its origin [m/s], shape (3,).
        spin: angular velocity [rad/s], shape (3,).
    """

    position: ArrayLike
    quaternion: ArrayLike
    velocity: ArrayLike
    angular_velocity: ArrayLike


class JointValues(NamedTuple):
    """Joints with their angles [rad] or lengths [m], speeds and efforts [N m] or [N], by name."""

    names: Sequence[str]
    positions: ArrayLike
    velocities: ArrayLike
    efforts: ArrayLike


class PayloadState(NamedTuple):
    """Soil in a machine's tools.

    Attributes:
        bank, loose: bank volume, and volume as it lies in the tools [m^3].
        mass: [kg].
        fill: loose volume in parts of the tool's heaped capacity, of the fullest tool.
        time: simulation time it is of [s]; an array message has no stamp.
    """

    bank: float
    loose: float
    mass: float
    fill: float
    time: float = 0.0


def to_joint_state(joints: JointValues, base: BaseState, stamp: Time) -> JointState:
    """The state of every joint, the virtual ones of the base included (effort 0).

    At a pitch of 90 degrees the rates of yaw and roll are not defined; roll then stands still.

    Args:
        joints: the machine's own.
        base: pose and motion of the base.
        stamp: end of the tick it is the state of.

    Raises:
        CodecError: other than one value for each name, or a quaternion that is none.
    """
    own = [
        _to_double_array(values, len(joints.names), what)
        for values, what in (
            (joints.positions, "joint positions"),
            (joints.velocities, "joint velocities"),
            (joints.efforts, "joint efforts"),
        )
    ]
    place = _to_double_array(base.position, 3, "base position")
    motion = _to_double_array(base.velocity, 3, "base velocity")
    angles = yaw_pitch_roll(rotation_matrix(base.quaternion))
    angular_velocity = _to_double_array(base.angular_velocity, 3, "base angular velocity")
    own[0].extend([*place, *angles])
    own[1].extend([*motion, *_angle_rates(angles, angular_velocity)])
    own[2].extend([0.0] * len(BASE_JOINTS))
    return JointState(
        header=Header(stamp=stamp),
        name=[*joints.names, *BASE_JOINTS],
        position=own[0],
        velocity=own[1],
        effort=own[2],
    )


def to_command_state(names: Sequence[str], velocities: ArrayLike, stamp: Time) -> JointState:
    """The command that takes effect at a tick.

    Args:
        names: joints and tracks.
        velocities: [rad/s] or [m/s], in the order of `names`; they cross bit by bit.
        stamp: end of the tick.

    Raises:
        CodecError: other than one finite value for each name.
    """
    values = _to_double_array(velocities, len(names), "commanded velocities")
    _check_finite(names, values)
    return JointState(header=Header(stamp=stamp), name=list(names), velocity=values)


def from_command_state(msg: JointState, names: Sequence[str]) -> Array:
    """The velocities of a command, in the order of `names`, shape (len(names),).

    Raises:
        CodecError: other names or another order, other than one finite velocity for each, or
            positions or efforts, which a command does not have.
    """
    if list(msg.name) != list(names):
        raise CodecError(
            f"the command names {', '.join(msg.name) or 'nothing'}; it must be of"
            f" {', '.join(names)}, in this order"
        )
    if len(msg.position) or len(msg.effort):
        raise CodecError("an applied command has velocities only; leave position and effort empty")
    if len(msg.velocity) != len(names):
        raise CodecError(f"the command has {len(msg.velocity)} velocities for {len(names)} names")
    _check_finite(names, msg.velocity)
    return np.array(msg.velocity, dtype=np.float64)


def to_payload_array(payload: PayloadState) -> Float64MultiArray:
    """The payload as one dimension of values whose label names each of them, with its unit."""
    return to_labelled_array(_PAYLOAD_LABEL, payload)


def from_payload_array(msg: Float64MultiArray) -> PayloadState:
    """The payload that a message holds.

    Raises:
        CodecError: another label, or other than one value for each name in it.
    """
    return PayloadState(*from_labelled_array(msg, _PAYLOAD_LABEL, "a payload"))


def to_cylinder_array(cylinders: Mapping[str, CylinderState], time: float) -> Float64MultiArray:
    """Cylinders as one dimension of values whose label names each of them, with its unit.

    Args:
        cylinders: by joint.
        time: simulation time they are of [s]; an array message has no stamp.
    """
    figures = [value for cylinder in cylinders.values() for value in cylinder]
    return to_labelled_array(_cylinder_label(list(cylinders)), [*figures, time])


def from_cylinder_array(
    msg: Float64MultiArray, joints: Sequence[str]
) -> tuple[dict[str, CylinderState], float]:
    """The cylinders of some joints that a message holds, and the time that they are of [s].

    Raises:
        CodecError: another label, or other than one value for each name in it.
    """
    *values, time = from_labelled_array(msg, _cylinder_label(joints), "cylinders")
    size = len(CylinderState._fields)
    return {
        joint: CylinderState(*values[k * size : (k + 1) * size]) for k, joint in enumerate(joints)
    }, time


def _cylinder_label(joints: Sequence[str]) -> str:
    return ",".join([*(f"{joint}_{figure}" for joint in joints for figure in _FIGURES), "time_s"])


def _angle_rates(
    angles: tuple[float, float, float], angular_velocity: Sequence[float]
) -> tuple[float, float, float]:
    """Rates of yaw, pitch, roll [rad/s] that make the angular velocity `spin`, map frame."""
    yaw, pitch, _ = angles
    s, c = math.sin(yaw), math.cos(yaw)
    # The frame after the yaw: roll's axis there is (cos pitch, 0, -sin pitch).
    x, y = (
        c * angular_velocity[0] + s * angular_velocity[1],
        c * angular_velocity[1] - s * angular_velocity[0],
    )
    level = math.cos(pitch)
    roll = x / level if abs(level) > _MIN_COS_PITCH else 0.0
    return angular_velocity[2] + math.sin(pitch) * roll, y, roll


def _to_double_array(values: ArrayLike, count: int, what: str) -> array.array[float]:
    """The values as a message takes them; nothing else is as fast."""
    found = np.asarray(values, dtype=np.float64)
    if found.shape != (count,):
        raise CodecError(f"{what} have shape {found.shape}; give {count} numbers")
    return array.array("d", found.tolist())


def _check_finite(names: Sequence[str], velocities: Sequence[float]) -> None:
    for name, velocity in zip(names, velocities, strict=True):
        if not math.isfinite(velocity):
            raise CodecError(f"the velocity of {name} is {velocity}; commands are finite numbers")
