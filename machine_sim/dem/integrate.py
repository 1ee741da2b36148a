"""Explicit integration of one substep: particles moved by forces, and soil locked to a tool."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.body_records import (
    ANGULAR_VELOCITY,
    CONTACT_RADIUS,
    DISPLACEMENT,
    FORCE,
    INVERSE_MASS,
    LIMIT_WEIGHTED_ANGULAR_VELOCITY,
    MASS_OVER_INERTIA,
    ROLLING_LIMIT,
    SURFACE_VELOCITY,
    TORQUE_OVER_RADIUS,
    VELOCITY,
    clear_force_sums,
)
from machine_sim.dem.tools.pose import ANGULAR, LINEAR, ORIGIN
from machine_sim.dem.vec3 import add, cross, dot, load_row, scale, store_row, subtract
from msg_bridge.kernels import helper

__all__ = ["advance_locked_loads", "integrate_bodies"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1e-20)


@helper(forceinline=True)
def integrate_bodies(rows, body, force_sums, radius, gravity, dt):  # type: ignore[no-untyped-def]
    """Advance particles by one substep of semi-implicit Euler, and clear their force sums.

    Rolling resistance acts on the angular velocity of a particle relative to the mean angular
    velocity of the bodies it touches, weighted with the rolling limits of the contacts. Its Coulomb
    limit is the sum over contacts of coefficient, radius and normal force. It is applied
    implicitly: a particle that the limit can hold does not turn at all, so that a heap comes to
    rest instead of creeping. Soil that turns as one body, as in a bucket, has no rolling resistance
    within.

    Args:
        rows: particles moved by forces, int64.
        body, force_sums: see `body_records`; updated.
        radius: full radius [m], shape (n,).
        gravity: acceleration of gravity, downward [m/s^2].
        dt: substep [s].
    """
    for i in rows:
        inverse_mass = body[i, INVERSE_MASS]
        if inverse_mass > _ZERO:
            dt_over_mass = inverse_mass * dt
            dvx, dvy, dvz = scale(load_row(force_sums, i, FORCE), dt_over_mass)
            velocity = add(load_row(body, i, VELOCITY), (dvx, dvy, dvz - gravity * dt))
            displacement = add(load_row(body, i, DISPLACEMENT), scale(velocity, dt))
            angular_velocity = _integrate_rotation(
                load_row(body, i, ANGULAR_VELOCITY), load_row(force_sums, i, TORQUE_OVER_RADIUS),
                load_row(force_sums, i, LIMIT_WEIGHTED_ANGULAR_VELOCITY),
                force_sums[i, ROLLING_LIMIT], body[i, CONTACT_RADIUS], radius[i],
                dt_over_mass * body[i, MASS_OVER_INERTIA],
            )  # fmt: skip
            store_row(body, i, VELOCITY, velocity)
            store_row(body, i, DISPLACEMENT, displacement)
            store_row(body, i, ANGULAR_VELOCITY, angular_velocity)
            store_row(body, i, SURFACE_VELOCITY, scale(angular_velocity, body[i, CONTACT_RADIUS]))
        clear_force_sums(force_sums, i)


@helper(forceinline=True)
def _integrate_rotation(  # type: ignore[no-untyped-def]
    angular_velocity, torque_over_radius, weighted_angular_velocity, rolling_limit,
    contact_radius, radius, dt_over_inertia,
):  # fmt: skip
    """Return the angular velocity [rad/s] after a substep of friction and rolling resistance.

    Args:
        angular_velocity: before the substep [rad/s].
        torque_over_radius, weighted_angular_velocity, rolling_limit: force sums.
        contact_radius, radius: arm of the friction and of the rolling resistance [m].
        dt_over_inertia: substep over moment of inertia [s/(kg m^2)].
    """
    neighbours = scale(weighted_angular_velocity, _ONE / max(rolling_limit, _TINY))
    turned = add(angular_velocity, scale(torque_over_radius, contact_radius * dt_over_inertia))
    rolling = subtract(turned, neighbours)
    speed = np.sqrt(dot(rolling, rolling))
    max_change = rolling_limit * radius * dt_over_inertia
    remaining = max(speed - max_change, _ZERO) / max(speed, _TINY)
    return add(neighbours, scale(rolling, remaining))


@helper(forceinline=True)
def advance_locked_loads(locked, body, force_sums, position, tools, step, dt):  # type: ignore[no-untyped-def]
    """Move soil locked to tools by one substep, and add the forces on it to the tools' wrenches.

    Args:
        locked: `LockedRows`.
        body, force_sums: see `body_records`; updated.
        position: centres at the start of the step [m], shape (n, 3).
        tools: `ToolMotion`; the wrench is summed over the substeps.
        step: number of the substep.
        dt: substep [s].
    """
    pose, wrench = tools.path[step], tools.wrench
    for k in range(locked.rows.size):
        i, t = locked.rows[k], locked.tool[k]
        centre = add(load_row(position, i, 0), load_row(body, i, DISPLACEMENT))
        arm = subtract(centre, load_row(pose, t, ORIGIN))
        force = load_row(force_sums, i, FORCE)
        torque = scale(load_row(force_sums, i, TORQUE_OVER_RADIUS), body[i, CONTACT_RADIUS])
        store_row(wrench, t, LINEAR, add(load_row(wrench, t, LINEAR), force))
        torque = add(cross(arm, force), torque)
        store_row(wrench, t, ANGULAR, add(load_row(wrench, t, ANGULAR), torque))
        for axis in range(3):
            body[i, DISPLACEMENT + axis] += body[i, VELOCITY + axis] * dt
        clear_force_sums(force_sums, i)
