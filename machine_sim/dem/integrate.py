"""Explicit integration of one substep: particles moved by forces, and soil locked to a tool."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.body_records import (
    ANGULAR_VELOCITY,
    BODY_RECORD_SIZE,
    CONTACT_RADIUS,
    DISPLACEMENT,
    FORCE,
    FORCE_RECORD_SIZE,
    FULL_RADIUS,
    INVERSE_MASS,
    LIMIT_WEIGHTED_ANGULAR_VELOCITY,
    MASS_OVER_INERTIA,
    ROLLING_LIMIT,
    SURFACE_VELOCITY,
    TORQUE_OVER_RADIUS,
    VELOCITY,
    clear_force_sums,
)
from machine_sim.dem.contacts.block_vectors import vector_access
from machine_sim.dem.contacts.simd import (
    GROUP_SIZE,
    VECTOR_SIZE,
    gather_records,
    round_up,
    scatter_records,
)
from machine_sim.dem.tools.pose import ANGULAR, LINEAR, ORIGIN
from machine_sim.dem.vec3 import add, cross, dot, load_row, scale, store_row, subtract
from msg_bridge.kernels import helper

__all__ = ["SCRATCH_SIZE", "advance_locked_loads", "integrate_bodies", "pad_rows"]

_BLOCK_SIZE = 64
"""Particles that are integrated together, a multiple of the lanes of the widest vector."""
SCRATCH_SIZE = (BODY_RECORD_SIZE + FORCE_RECORD_SIZE) * _BLOCK_SIZE
"""Floats of working memory for a block."""
_VECTOR = 0b111
_BODY_COLUMNS = 0xFFFF & ~(_VECTOR << SURFACE_VELOCITY)
_SUM_COLUMNS = (
    _VECTOR << FORCE
    | 1 << ROLLING_LIMIT
    | _VECTOR << TORQUE_OVER_RADIUS
    | _VECTOR << LIMIT_WEIGHTED_ANGULAR_VELOCITY
)
"""Columns that are read or written back, a bit for each."""
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1e-20)

_load, _store = vector_access(_BLOCK_SIZE)


@helper(allocates=True)
def pad_rows(rows):  # type: ignore[no-untyped-def]
    """Return rows in whole groups of `GROUP_SIZE`, the last one repeated, uint32."""
    padded = np.empty(round_up(rows.size, GROUP_SIZE), np.uint32)
    for k in range(padded.size):
        padded[k] = rows[min(k, rows.size - 1)]
    return padded


@helper(forceinline=True)
def integrate_bodies(rows, body, force_sums, gravity, dt, scratch):  # type: ignore[no-untyped-def]
    """Advance particles by one substep of semi-implicit Euler, and clear their force sums.

    Rolling resistance acts on the angular velocity of a particle relative to the mean angular
    velocity of the bodies it touches, weighted with the rolling limits of the contacts. Its Coulomb
    limit is the sum over contacts of coefficient, radius and normal force. It is applied
    implicitly: a particle that the limit can hold does not turn at all, so that a heap comes to
    rest instead of creeping. Soil that turns as one body, as in a bucket, has no rolling resistance
    within.

    Args:
        rows: particles moved by forces, in whole groups, see `pad_rows`.
        body, force_sums: see `body_records`; updated.
        gravity: acceleration of gravity, downward [m/s^2].
        dt: substep [s].
        scratch: working memory, shape (SCRATCH_SIZE,), float32.
    """
    bodies = scratch[: BODY_RECORD_SIZE * _BLOCK_SIZE]
    sums = scratch[BODY_RECORD_SIZE * _BLOCK_SIZE :]
    for begin in range(0, rows.size, _BLOCK_SIZE):
        count = min(rows.size - begin, _BLOCK_SIZE)
        for s in range(0, count, GROUP_SIZE):
            gather_records(body, rows, begin + s, bodies, _BLOCK_SIZE, s, _BODY_COLUMNS)
            gather_records(force_sums, rows, begin + s, sums, _BLOCK_SIZE, s, _SUM_COLUMNS)
        _integrate_block(round_up(count, VECTOR_SIZE), bodies, sums, gravity, dt)
        # A row that is repeated in a group is written several times with the same values.
        for s in range(0, count, GROUP_SIZE):
            scatter_records(body, rows, begin + s, bodies, _BLOCK_SIZE, s)
        for s in range(count):
            clear_force_sums(force_sums, rows[begin + s])


@helper
def _integrate_block(count, bodies, sums, gravity, dt):  # type: ignore[no-untyped-def]
    """Advance the first particles of a block.

    Args:
        count: their number, a multiple of `VECTOR_SIZE`.
        bodies, sums: their body records and force sums, flat; column q of slot s is at
            `q * _BLOCK_SIZE + s`.
        gravity: acceleration of gravity, downward [m/s^2].
        dt: substep [s].
    """
    for s in range(np.uint64(count)):
        dt_over_mass = bodies[INVERSE_MASS * _BLOCK_SIZE + s] * dt
        contact_radius = bodies[CONTACT_RADIUS * _BLOCK_SIZE + s]
        dvx, dvy, dvz = scale(_load(sums, FORCE * _BLOCK_SIZE, s), dt_over_mass)
        velocity = add(_load(bodies, VELOCITY * _BLOCK_SIZE, s), (dvx, dvy, dvz - gravity * dt))
        displacement = add(_load(bodies, DISPLACEMENT * _BLOCK_SIZE, s), scale(velocity, dt))
        angular_velocity = _integrate_rotation(
            _load(bodies, ANGULAR_VELOCITY * _BLOCK_SIZE, s),
            _load(sums, TORQUE_OVER_RADIUS * _BLOCK_SIZE, s),
            _load(sums, LIMIT_WEIGHTED_ANGULAR_VELOCITY * _BLOCK_SIZE, s),
            sums[ROLLING_LIMIT * _BLOCK_SIZE + s],
            contact_radius,
            bodies[FULL_RADIUS * _BLOCK_SIZE + s],
            dt_over_mass * bodies[MASS_OVER_INERTIA * _BLOCK_SIZE + s],
        )
        _store(bodies, VELOCITY * _BLOCK_SIZE, s, velocity)
        _store(bodies, DISPLACEMENT * _BLOCK_SIZE, s, displacement)
        _store(bodies, ANGULAR_VELOCITY * _BLOCK_SIZE, s, angular_velocity)
        _store(bodies, SURFACE_VELOCITY * _BLOCK_SIZE, s, scale(angular_velocity, contact_radius))


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
