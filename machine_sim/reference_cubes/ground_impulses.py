"""Impulses of the ground on one cube: normal and Coulomb friction, by projected Gauss-Seidel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper

__all__ = ["ContactPoints", "solve_impulses"]

_NUM_SOLVER_ITERATIONS = 10
"""Iterations over the contact points of a cube."""


class ContactPoints(NamedTuple):
    """Contact points of one cube with the ground; impulses are per kilogram.

    Attributes:
        arm: from the centre [m], map axes, shape (points, 3).
        min_normal_speed: minimum normal speed after the impulses [m/s], shape (points,).
        normal_impulse: [m/s], 0 or more, shape (points,).
        friction_impulse: [m/s], map axes, shape (points, 3).
    """

    arm: NDArray[np.float64]
    min_normal_speed: NDArray[np.float64]
    normal_impulse: NDArray[np.float64]
    friction_impulse: NDArray[np.float64]


@helper
def solve_impulses(points, num_points, normal, friction, h, velocity, angular_velocity):  # type: ignore[no-untyped-def]
    """Apply normal and friction impulses to one cube: projected Gauss-Seidel iterations.

    Args:
        points: `ContactPoints` with cleared impulses.
        num_points: number of contact points.
        normal: unit normal of the ground.
        friction: Coulomb coefficient.
        h: half edge [m].
        velocity, angular_velocity: [m/s], [rad/s], expected at the end of the step.

    Returns:
        Velocity and angular velocity after the impulses, three components each.
    """
    nx, ny, nz = normal
    vx, vy, vz = velocity
    wx, wy, wz = angular_velocity
    arm, normal_impulse, friction_impulse = (
        points.arm,
        points.normal_impulse,
        points.friction_impulse,
    )
    # Impulses are per kilogram; the moment of inertia of a cube is the same about every axis.
    angular_compliance = 1.5 / (h * h)
    for _ in range(_NUM_SOLVER_ITERATIONS):
        for p in range(num_points):
            ax, ay, az = arm[p, 0], arm[p, 1], arm[p, 2]
            ux, uy, uz = vx + wy * az - wz * ay, vy + wz * ax - wx * az, vz + wx * ay - wy * ax
            tx, ty, tz = ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx
            un = ux * nx + uy * ny + uz * nz
            before = normal_impulse[p]
            compliance = 1.0 + angular_compliance * (tx * tx + ty * ty + tz * tz)
            change = (points.min_normal_speed[p] - un) / compliance
            normal_impulse[p] = max(before + change, 0.0)
            j = normal_impulse[p] - before
            vx, vy, vz = vx + j * nx, vy + j * ny, vz + j * nz
            wx = wx + angular_compliance * j * tx
            wy = wy + angular_compliance * j * ty
            wz = wz + angular_compliance * j * tz
            ux, uy, uz = vx + wy * az - wz * ay, vy + wz * ax - wx * az, vz + wx * ay - wy * ax
            un = ux * nx + uy * ny + uz * nz
            mobility = 1.0 / (1.0 + angular_compliance * (ax * ax + ay * ay + az * az))
            fx = friction_impulse[p, 0] - mobility * (ux - un * nx)
            fy = friction_impulse[p, 1] - mobility * (uy - un * ny)
            fz = friction_impulse[p, 2] - mobility * (uz - un * nz)
            size, limit = np.sqrt(fx * fx + fy * fy + fz * fz), friction * normal_impulse[p]
            if size > limit:
                fx, fy, fz = fx * limit / size, fy * limit / size, fz * limit / size
            jx = fx - friction_impulse[p, 0]
            jy = fy - friction_impulse[p, 1]
            jz = fz - friction_impulse[p, 2]
            friction_impulse[p, 0], friction_impulse[p, 1], friction_impulse[p, 2] = fx, fy, fz
            vx, vy, vz = vx + jx, vy + jy, vz + jz
            wx += angular_compliance * (ay * jz - az * jy)
            wy += angular_compliance * (az * jx - ax * jz)
            wz += angular_compliance * (ax * jy - ay * jx)
    return vx, vy, vz, wx, wy, wz
