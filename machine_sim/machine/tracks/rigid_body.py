"""Helpers of the track kernels: rotated vectors, velocities of points, and wrenches.

Vectors are tuples of three floats and rotation matrices tuples of three rows, which the compiler
keeps in registers; arrays would be read again after every write to another array.
"""

from __future__ import annotations

from typing import NamedTuple

from machine_sim.machine.base_motion import ANGULAR_VELOCITY, CENTER_OF_MASS, VELOCITY
from machine_sim.machine.box import Vec3
from msg_bridge.kernels import helper

__all__ = [
    "FORCE_X",
    "FORCE_Y",
    "FORCE_Z",
    "BaseFrame",
    "add_wrench",
    "base_frame",
    "dot",
    "point_velocity",
    "row_vector",
    "to_base",
    "to_map",
]

FORCE_X, FORCE_Y, FORCE_Z, TORQUE_X, TORQUE_Y, TORQUE_Z = range(6)
"""Slots of a wrench."""


class BaseFrame(NamedTuple):
    """Pose and motion of the base's centre of mass in the map frame."""

    center_of_mass: Vec3
    rotation: tuple[Vec3, Vec3, Vec3]
    velocity: Vec3
    angular_velocity: Vec3


@helper(forceinline=True)
def base_frame(motion):  # type: ignore[no-untyped-def]
    """Return the rows of a packed motion of the base (`base_motion`) as tuples."""
    return BaseFrame(
        (motion[CENTER_OF_MASS, 0], motion[CENTER_OF_MASS, 1], motion[CENTER_OF_MASS, 2]),
        (
            (motion[0, 0], motion[0, 1], motion[0, 2]),
            (motion[1, 0], motion[1, 1], motion[1, 2]),
            (motion[2, 0], motion[2, 1], motion[2, 2]),
        ),
        (motion[VELOCITY, 0], motion[VELOCITY, 1], motion[VELOCITY, 2]),
        (motion[ANGULAR_VELOCITY, 0], motion[ANGULAR_VELOCITY, 1], motion[ANGULAR_VELOCITY, 2]),
    )


@helper(forceinline=True)
def row_vector(array, row, column):  # type: ignore[no-untyped-def]
    """Return three neighbouring values of a row of an array, from a column on."""
    return array[row, column], array[row, column + 1], array[row, column + 2]


@helper(forceinline=True)
def dot(a, b):  # type: ignore[no-untyped-def]
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@helper(forceinline=True)
def to_map(rotation, vector):  # type: ignore[no-untyped-def]
    """Rotate a vector from the base frame to the map frame."""
    row0, row1, row2 = rotation
    return dot(row0, vector), dot(row1, vector), dot(row2, vector)


@helper(forceinline=True)
def to_base(rotation, vector):  # type: ignore[no-untyped-def]
    """Rotate a vector from the map frame to the base frame."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation
    x, y, z = vector
    return (
        r00 * x + r10 * y + r20 * z,
        r01 * x + r11 * y + r21 * z,
        r02 * x + r12 * y + r22 * z,
    )


@helper(forceinline=True)
def point_velocity(velocity, angular_velocity, arm):  # type: ignore[no-untyped-def]
    """Return the velocity of the point at `arm` [m] from a reference point of a rigid body."""
    (vx, vy, vz), (wx, wy, wz), (x, y, z) = velocity, angular_velocity, arm
    return vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x


@helper(forceinline=True)
def add_wrench(wrench, force, arm):  # type: ignore[no-untyped-def]
    """Add a force [N] that acts at `arm` [m] to a wrench about the origin of `arm`."""
    (fx, fy, fz), (x, y, z) = force, arm
    wrench[FORCE_X] += fx
    wrench[FORCE_Y] += fy
    wrench[FORCE_Z] += fz
    wrench[TORQUE_X] += y * fz - z * fy
    wrench[TORQUE_Y] += z * fx - x * fz
    wrench[TORQUE_Z] += x * fy - y * fx
