"""Pose and motion of a machine's base as one array, which kernels take faster than several.

A motion has shape (7, 3), map frame: the rotation matrix base to map in its first three rows, then
the rows below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.box import Vec3
from machine_sim.machine.rotated_vectors import rotate_to_map
from machine_sim.machine.rotations import set_rotation
from msg_bridge.kernels import fixed_signature_kernel

__all__ = [
    "ANGULAR_VELOCITY",
    "CENTER_OF_MASS",
    "ORIGIN",
    "ROTATION",
    "VELOCITY",
    "base_motion",
]

ROTATION = slice(0, 3)
"""Rows of the rotation matrix."""

CENTER_OF_MASS, VELOCITY, ANGULAR_VELOCITY, ORIGIN = range(3, 7)
"""Rows of the centre of mass [m], its velocity [m/s], the angular velocity [rad/s], and the origin
of the base frame [m]."""

_NUM_ROWS = 7


def base_motion(
    center_of_mass: Vec3,
    quaternion: tuple[float, float, float, float],
    velocity: Vec3,
    angular_velocity: Vec3,
    base_com: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return a motion as an array of its own, shape (7, 3).

    Args:
        center_of_mass: of the base [m].
        quaternion: base to map, x, y, z, w, of any length.
        velocity, angular_velocity: of the centre of mass [m/s], and of the base [rad/s].
        base_com: centre of mass of the base, base frame [m], shape (3,).
    """
    motion = np.empty((_NUM_ROWS, 3))
    _set_motion(center_of_mass, quaternion, velocity, angular_velocity, base_com, motion)
    return motion


@fixed_signature_kernel
def _set_motion(  # type: ignore[no-untyped-def]
    center_of_mass, quaternion, velocity, angular_velocity, base_com, motion
):
    """Fill the array of `base_motion`."""
    x, y, z, w = quaternion
    set_rotation(x, y, z, w, motion)
    motion[CENTER_OF_MASS] = center_of_mass
    motion[VELOCITY] = velocity
    motion[ANGULAR_VELOCITY] = angular_velocity
    arm = rotate_to_map(motion, base_com[0], base_com[1], base_com[2])
    for axis in range(3):
        motion[ORIGIN, axis] = center_of_mass[axis] - arm[axis]
