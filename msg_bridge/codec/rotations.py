"""Unit quaternions, rotation matrices, and yaw, pitch and roll."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode

__all__ = ["rotation_matrix", "unit_quaternion", "yaw_pitch_roll"]

Array = NDArray[np.float64]


def unit_quaternion(quaternion: ArrayLike) -> tuple[float, float, float, float]:
    """Normalise a quaternion x, y, z, w.

    Raises:
        CodecError: VALUE: not four finite numbers, or all of them zero.
    """
    parts = np.asarray(quaternion, dtype=np.float64)
    if parts.shape == (4,):
        x, y, z, w = parts.tolist()
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if 0.0 < norm < math.inf:  # NaN fails
            return x / norm, y / norm, z / norm, w / norm
    raise CodecError(
        f"{quaternion!r} is not a rotation; give a quaternion x, y, z, w", ErrorCode.VALUE
    )


def rotation_matrix(quaternion: ArrayLike) -> Array:
    """Return the rotation matrix, shape (3, 3), of a quaternion x, y, z, w of any norm.

    Raises:
        CodecError: VALUE: not four finite numbers, or all of them zero.
    """
    x, y, z, w = unit_quaternion(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def yaw_pitch_roll(rotation: Array) -> tuple[float, float, float]:
    """Return the angles [rad] with Rz(yaw) Ry(pitch) Rx(roll) = rotation, shape (3, 3).

    Accurate at any pitch. At 90 degrees yaw is arbitrary; roll is computed from the rotation that
    remains after the yaw, not from matrix elements that vanish there.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, _, _) = rotation.tolist()
    yaw = math.atan2(yx, xx)
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-zx, c * xx + s * yx)
    roll = math.atan2(s * xz - c * yz, c * yy - s * xy)
    return yaw, pitch, roll
