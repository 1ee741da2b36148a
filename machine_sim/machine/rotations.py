"""Rotation matrices, quaternions and cross products of single 3-vectors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.box import Vec3
from msg_bridge.kernels import fixed_signature_kernel, helper

__all__ = [
    "cross",
    "pose_of",
    "quaternion_from_matrix",
    "rotation_about_z",
    "rotation_from_rpy",
    "rotation_matrix",
    "rotation_of",
    "rpy_from_rotation",
    "set_rotation",
]

Array = NDArray[np.float64]


def rotation_matrix(quaternion: ArrayLike) -> Array:
    """Return the rotation matrix, shape (3, 3), of a quaternion x, y, z, w of any length."""
    return rotation_of(*np.asarray(quaternion, dtype=np.float64).tolist())


def rotation_of(x: float, y: float, z: float, w: float) -> Array:
    """Return `rotation_matrix` of four floats; it is fast, because machines need it often."""
    rotation, _ = pose_of((0.0, 0.0, 0.0), (x, y, z, w))
    return rotation


def pose_of(origin: Vec3, quaternion: tuple[float, float, float, float]) -> tuple[Array, Array]:
    """Return a pose as arrays: rotation matrix, shape (3, 3), and origin, shape (3,).

    The arrays are made here: one that a kernel makes takes four times as long to return.

    Args:
        origin: three floats.
        quaternion: x, y, z, w, of any length.
    """
    rotation, position = np.empty((3, 3)), np.empty(3)
    _set_pose(origin, quaternion, rotation, position)
    return rotation, position


@fixed_signature_kernel
def _set_pose(origin, quaternion, rotation, position):  # type: ignore[no-untyped-def]
    """Fill the arrays of `pose_of`."""
    x, y, z, w = quaternion
    set_rotation(x, y, z, w, rotation)
    position[0], position[1], position[2] = origin


@helper
def set_rotation(x, y, z, w, rotation):  # type: ignore[no-untyped-def]
    """Fill the first three rows of an array with the rotation matrix of a quaternion."""
    # The quaternions of the physics engine have unit length only to about 1e-6.
    scale = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x * scale, y * scale, z * scale, w * scale
    rotation[0] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    rotation[1] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    rotation[2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


def quaternion_from_matrix(rotation: Array) -> list[float]:
    """Return the unit quaternion x, y, z, w of a rotation matrix, shape (3, 3).

    It is computed from the row for the component of largest magnitude, which is well conditioned.
    """
    m = rotation
    squares = [
        1.0 + m[0, 0] - m[1, 1] - m[2, 2],
        1.0 - m[0, 0] + m[1, 1] - m[2, 2],
        1.0 - m[0, 0] - m[1, 1] + m[2, 2],
        1.0 + m[0, 0] + m[1, 1] + m[2, 2],
    ]
    x, y, z, w = squares
    rows = (
        (x, m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]),
        (m[1, 0] + m[0, 1], y, m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]),
        (m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], z, m[1, 0] - m[0, 1]),
        (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], w),
    )
    row = np.array(rows[int(np.argmax(squares))])
    quaternion: list[float] = (row / np.linalg.norm(row)).tolist()
    return quaternion


def rotation_about_z(angle: float) -> Array:
    """Return the rotation matrix, shape (3, 3), of a rotation about +z [rad]."""
    s, c = math.sin(angle), math.cos(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_from_rpy(rpy: tuple[float, float, float]) -> Array:
    """Return the rotation matrix, shape (3, 3), of rotations about the fixed axes x, y, z [rad]."""
    (sr, sp, sy), (cr, cp, cy) = map(math.sin, rpy), map(math.cos, rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_from_rotation(rotation: Array) -> tuple[float, float, float]:
    """Return the rotations about the fixed axes x, y, z [rad] of a matrix, shape (3, 3).

    With a pitch of 90 degrees roll and yaw are not unique; the yaw is 0 then.
    """
    m = rotation.tolist()
    level = math.hypot(m[0][0], m[1][0])
    pitch = math.atan2(-m[2][0], level)
    yaw = 0.0 if level < 1e-9 else math.atan2(m[1][0], m[0][0])
    # The roll that is left after the yaw: near a pitch of 90 degrees the yaw is not exact.
    s, c = math.sin(yaw), math.cos(yaw)
    return math.atan2(s * m[0][2] - c * m[1][2], c * m[1][1] - s * m[0][1]), pitch, yaw


def cross(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors, shape (3,); 20 times as fast as `numpy.cross`."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
