"""Sums of forces and the wrenches they reduce to, for force kernels."""

from __future__ import annotations

import math

from msg_bridge.kernels import helper
from soil_sim.vec3 import cross, divide

__all__ = [
    "NUM_SUMS",
    "WRENCH_FORCE",
    "WRENCH_POINT",
    "WRENCH_SIZE",
    "WRENCH_TORQUE",
    "add_force",
    "reduce_wrench",
]

_SUM_FORCE = 0
"""Slots 0 to 2: sum of the forces [N]."""
_SUM_TORQUE = 3
"""Slots 3 to 5: sum of the torques about the origin [N m]."""
_SUM_MOMENT = 6
"""Slots 6 to 8: sum of the points, weighted by the force magnitudes [N m]."""
_SUM_MAGNITUDE = 9
"""Sum of the force magnitudes [N]."""
NUM_SUMS = 10
"""Number of slots of `sums`."""

WRENCH_POINT = 0
"""Slots 0 to 2 of a wrench: point of application [m]."""
WRENCH_FORCE = 3
"""Slots 3 to 5: force [N]."""
WRENCH_TORQUE = 6
"""Slots 6 to 8: torque about the point of application [N m]."""
WRENCH_SIZE = 9
"""Number of slots of a wrench."""


@helper
def add_force(sums, at, force):  # type: ignore[no-untyped-def]
    """Add a force [N] at a point [m] relative to the origin of the sums; `sums` has shape (10,)."""
    x, y, z = at
    fx, fy, fz = force
    magnitude = math.sqrt(fx * fx + fy * fy + fz * fz)
    sums[_SUM_FORCE] += fx
    sums[_SUM_FORCE + 1] += fy
    sums[_SUM_FORCE + 2] += fz
    sums[_SUM_TORQUE] += y * fz - z * fy
    sums[_SUM_TORQUE + 1] += z * fx - x * fz
    sums[_SUM_TORQUE + 2] += x * fy - y * fx
    sums[_SUM_MOMENT] += magnitude * x
    sums[_SUM_MOMENT + 1] += magnitude * y
    sums[_SUM_MOMENT + 2] += magnitude * z
    sums[_SUM_MAGNITUDE] += magnitude


@helper
def reduce_wrench(sums, origin, wrench):  # type: ignore[no-untyped-def]
    """Write the wrench of the forces added by `add_force`.

    The point of application is the mean of their points, weighted by the force magnitudes.

    Args:
        sums: sums of `add_force`, shape (10,).
        origin: origin of the sums in the map frame [m].
        wrench: output, shape (9,).
    """
    for axis in range(3):
        wrench[WRENCH_POINT + axis] = origin[axis]
    magnitude = sums[_SUM_MAGNITUDE]
    if magnitude > 0.0:
        at = divide((sums[_SUM_MOMENT], sums[_SUM_MOMENT + 1], sums[_SUM_MOMENT + 2]), magnitude)
        torque = cross(at, (sums[_SUM_FORCE], sums[_SUM_FORCE + 1], sums[_SUM_FORCE + 2]))
        for axis in range(3):
            wrench[WRENCH_POINT + axis] += at[axis]
            wrench[WRENCH_FORCE + axis] = sums[_SUM_FORCE + axis]
            wrench[WRENCH_TORQUE + axis] = sums[_SUM_TORQUE + axis] - torque[axis]
