"""Sensors of a machine as messages: inertial units and joint encoders."""

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

__all__ = ["to_encoder_joint_state", "to_imu"]


def to_imu(
    quaternion: ArrayLike,
    angular_velocity: ArrayLike,
    specific_force: ArrayLike,
    frame_id: str,
    stamp: Time,
) -> Imu:
    """What an inertial unit says; its covariances are left at 0, unknown.

    Args:
        quaternion: of the unit in the map, x, y, z, w.
        spin: angular velocity [rad/s], unit's axes, shape (3,).
        specific_force: acceleration less gravity [m/s^2], unit's axes, shape (3,); at rest it is
            9.81 upward, as REP-145 has it.
        frame_id: frame of the unit's axes.
        stamp: end of the tick that it is of.

    Raises:
        CodecError: a vector or quaternion that is none.
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
    """What encoders say of the joints `names`, stamped with the time [s] that it is of.

    Raises:
        CodecError: other than one angle [rad] and one speed [rad/s] for each name.
    """
    positions, velocities = np.asarray(angles, np.float64), np.asarray(speeds, np.float64)
    if positions.shape != (len(names),) or velocities.shape != (len(names),):
        raise CodecError(
            f"angles have shape {positions.shape} and speeds {velocities.shape}; give"
            f" {len(names)} of each"
        )
    return JointState(
        header=Header(stamp=stamp_from_seconds(time)),
        name=list(names),
        position=positions.tolist(),
        velocity=velocities.tolist(),
    )


def _vector3(values: ArrayLike, what: str) -> Vector3:
    found = np.asarray(values, dtype=np.float64)
    if found.shape != (3,):
        raise CodecError(f"the {what} has shape {found.shape}; give three numbers")
    x, y, z = found.tolist()
    return Vector3(x=x, y=y, z=z)
