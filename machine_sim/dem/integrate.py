"""The working copy of the particles during one step: a record of float32 per particle.

A record is as large as a cache line, so that a contact reads one or two lines per particle. Places
are *displacements since the start of the step*: small numbers, which float32 holds to nanometres
however large the map is; the store keeps positions in float64.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.dem.partition import NUM_CHUNKS, row_chunk
from msg_bridge.kernels import kernel, threaded_kernel

__all__ = [
    "BODY_RECORD_SIZE",
    "FORCE_RECORD_SIZE",
    "advance_locked_loads",
    "integrate_bodies",
    "load_body_records",
    "store_body_records",
]

BODY_RECORD_SIZE = 16
"""Columns of a body: displacement [m] (3), contact radius [m], velocity [m/s] (3), 1/mass [1/kg],
surface speed: spin times contact radius [m/s] (3), unused, spin [rad/s] (3), mass over moment of
inertia [1/m^2]."""

FORCE_RECORD_SIZE = 16
"""Columns of a sum over contacts: force [N] (3), rolling limit [N], turning force: torque over
contact radius [N] (3), unused (5), spin of the others times their share of the rolling limit
[N rad/s] (3), unused."""

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1e-20)
_INERTIA = np.float32(2.5)
"""1 / 0.4: moment of inertia of a solid sphere is 0.4 m r^2."""


@threaded_kernel
def load_body_records(  # type: ignore[no-untyped-def]
    rows,
    body,
    force_sums,
    velocity,
    angular_velocity,
    contact_radius,
    radius,
    inverse_mass,
    sleep_state,
):
    """Fill the records of `rows` and clear their sums; the others are columns of the store."""
    for c in prange(NUM_CHUNKS):
        _load(
            row_chunk(rows, c), body, force_sums, velocity, angular_velocity, contact_radius, radius, inverse_mass,
            sleep_state,
        )  # fmt: skip


@kernel
def _load(  # type: ignore[no-untyped-def]
    rows,
    body,
    force_sums,
    velocity,
    angular_velocity,
    contact_radius,
    radius,
    inverse_mass,
    sleep_state,
):
    for i in rows:
        for axis in range(3):
            body[i, axis] = _ZERO
            body[i, 4 + axis] = velocity[i, axis]
            body[i, 8 + axis] = angular_velocity[i, axis] * contact_radius[i]
            body[i, 12 + axis] = angular_velocity[i, axis]
        body[i, 3] = contact_radius[i]
        body[i, 7] = inverse_mass[i] if sleep_state[i] == 0 else _ZERO
        body[i, 15] = _INERTIA / (radius[i] * radius[i])
        for k in range(FORCE_RECORD_SIZE):
            force_sums[i, k] = _ZERO


@kernel
def integrate_bodies(rows, body, force_sums, radius, gravity, dt):  # type: ignore[no-untyped-def]
    """One substep of semi-implicit Euler; clears the sums.

    Spin: the torque of friction turns a particle, and rolling resistance holds it back, toward the
    mean spin of what it touches: its Coulomb limit is the sum over contacts of coefficient, radius
    and normal force. It is applied implicitly, so that a particle which the limit can hold does
    not turn at all: a heap comes to rest instead of creeping. A whole that turns as one (soil in a
    bucket) feels none of it.

    Args:
        rows: who moves.
        body, total: records and sums, shapes (n, BODY_RECORD_SIZE), (n, FORCE_RECORD_SIZE).
        radius: full radius [m], shape (n,).
        gravity: [m/s^2], downward.
        dt: [s].
    """
    for i in rows:
        w = body[i, 7]
        if w > _ZERO:
            change = w * dt
            body[i, 4] += force_sums[i, 0] * change
            body[i, 5] += force_sums[i, 1] * change
            body[i, 6] += force_sums[i, 2] * change - gravity * dt
            body[i, 0] += body[i, 4] * dt
            body[i, 1] += body[i, 5] * dt
            body[i, 2] += body[i, 6] * dt
            r, limit, arm = radius[i], force_sums[i, 3], body[i, 3]
            change *= body[i, 15]
            share = _ONE / max(limit, _TINY)
            mx, my, mz = (
                force_sums[i, 12] * share,
                force_sums[i, 13] * share,
                force_sums[i, 14] * share,
            )
            turn = arm * change
            x = body[i, 12] + force_sums[i, 4] * turn - mx
            y = body[i, 13] + force_sums[i, 5] * turn - my
            z = body[i, 14] + force_sums[i, 6] * turn - mz
            size = np.sqrt(x * x + y * y + z * z)
            held = limit * r * change
            left = max(size - held, _ZERO) / max(size, _TINY)
            x, y, z = mx + x * left, my + y * left, mz + z * left
            body[i, 12], body[i, 13], body[i, 14] = x, y, z
            body[i, 8], body[i, 9], body[i, 10] = x * arm, y * arm, z * arm
        for k in range(FORCE_RECORD_SIZE):
            force_sums[i, k] = _ZERO


@threaded_kernel
def store_body_records(rows, body, position, velocity, angular_velocity):  # type: ignore[no-untyped-def]
    """Take the motion of `rows` over into the store's columns."""
    for c in prange(NUM_CHUNKS):
        _finish(row_chunk(rows, c), body, position, velocity, angular_velocity)


@kernel
def _finish(rows, body, position, velocity, angular_velocity):  # type: ignore[no-untyped-def]
    for i in rows:
        for axis in range(3):
            position[i, axis] += body[i, axis]
            velocity[i, axis] = body[i, 4 + axis]
            angular_velocity[i, axis] = body[i, 12 + axis]


@kernel
def advance_locked_loads(rows, tool, body, force_sums, position, tools, step, dt):  # type: ignore[no-untyped-def]
    """One substep of soil that rides in a tool: it goes along, and hands on what presses on it.

    Args:
        rows, tool: who rides, and in which tool.
        body, total: as above.
        position: [m], at the start of the step.
        tools: `ToolMotion`; the wrench sums over the substeps.
        step: number of the substep.
        dt: [s].
    """
    pose, wrench = tools.path[step], tools.wrench
    for k in range(rows.size):
        i, t = rows[k], tool[k]
        fx, fy, fz = force_sums[i, 0], force_sums[i, 1], force_sums[i, 2]
        x = position[i, 0] + body[i, 0] - pose[t, 9]
        y = position[i, 1] + body[i, 1] - pose[t, 10]
        z = position[i, 2] + body[i, 2] - pose[t, 11]
        wrench[t, 0] += fx
        wrench[t, 1] += fy
        wrench[t, 2] += fz
        arm = body[i, 3]
        wrench[t, 3] += y * fz - z * fy + force_sums[i, 4] * arm
        wrench[t, 4] += z * fx - x * fz + force_sums[i, 5] * arm
        wrench[t, 5] += x * fy - y * fx + force_sums[i, 6] * arm
        for axis in range(3):
            body[i, axis] += body[i, 4 + axis] * dt
        for c in range(FORCE_RECORD_SIZE):
            force_sums[i, c] = _ZERO
