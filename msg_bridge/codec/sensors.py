"""Sensors of a machine as messages: inertial measurement units and joint encoders."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Vector3
from numpy.typing import ArrayLike
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Header

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.rotations import unit_quaternion
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.contract.errors import ErrorCode

__all__ = ["to_encoder_joint_state", "to_imu"]


def to_imu(
    quaternion: ArrayLike,
    angular_velocity: ArrayLike,
    specific_force: ArrayLike,
    frame_id: str,
    stamp: Time,
) -> Imu:
    """Encode a measurement of an inertial unit; covariances of 0 mean unknown.

    Args:
        quaternion: orientation, unit to map, x, y, z, w.
        angular_velocity: [rad/s], unit's axes, shape (3,).
        specific_force: acceleration minus gravity [m/s^2], unit's axes, shape (3,); 9.81 upward at
            rest (REP-145).
        frame_id: frame of the unit's axes.
        stamp: end of the tick of the measurement.

    Raises:
        CodecError: SHAPE, or VALUE of the quaternion.
    """
    x, y, z, w = unit_quaternion(quaternion)
    return Imu(
        header=Header(stamp=stamp, frame_id=frame_id),
        orientation=Quaternion(x=x, y=y, z=z, w=w),
        angular_velocity=_vector3(angular_velocity, "angular velocity"),
        linear_acceleration=_vector3(specific_force, "specific force"),
    )


def to_encoder_joint_state(
    names: Sequence[str], time: float, angles: ArrayLike, speeds: ArrayLike
) -> JointState:
    """Encode measured angles [rad] and speeds [rad/s] of joints, stamped with their time [s].

    Raises:
        CodecError: SHAPE: other than one angle and one speed for each name.
    """
    positions, velocities = np.asarray(angles, np.float64), np.asarray(speeds, np.float64)
    if positions.shape != (len(names),) or velocities.shape != (len(names),):
        raise CodecError(
            f"angles have shape {positions.shape} and speeds {velocities.shape}; give"
            f" {len(names)} of each",
            ErrorCode.SHAPE,
        )
    return JointState(
        header=Header(stamp=stamp_from_seconds(time)),
        name=list(names),
        position=positions.tolist(),
        velocity=velocities.tolist(),
    )


def _vector3(values: ArrayLike, what: str) -> Vector3:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (3,):
        raise CodecError(f"the {what} has shape {vector.shape}; give 3 numbers", ErrorCode.SHAPE)
    x, y, z = vector.tolist()
    return Vector3(x=x, y=y, z=z)
