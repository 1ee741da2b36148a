"""Packed records of the particles during one step, and how they are filled and read back.

Every particle has two records of 16 float32, each as large as a cache line, so that a contact reads
one or two lines per particle: the *body record* with its motion, and the *force sums*, which the
contacts of a substep add to. Positions are displacements since the start of the step: small
numbers, which float32 holds to nanometres however large the map is; `ParticleState` keeps the
positions in float64.

Tools have records, too, in the last rows of the same arrays (`tool_record_row`).

The vectors of a record start at columns 0, 4, 8 and 12, the lanes that `contacts.simd` reads.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.dem.partition import NUM_CHUNKS, row_chunk
from machine_sim.dem.state import AWAKE
from machine_sim.dem.vec3 import load_row, scale, store_row
from msg_bridge.kernels import helper, kernel, threaded_helper, threaded_kernel

__all__ = [
    "ANGULAR_VELOCITY",
    "BODY_RECORD_SIZE",
    "CONTACT_RADIUS",
    "DISPLACEMENT",
    "FORCE",
    "FORCE_RECORD_SIZE",
    "FULL_RADIUS",
    "INVERSE_MASS",
    "LIMIT_WEIGHTED_ANGULAR_VELOCITY",
    "MASS_OVER_INERTIA",
    "ROLLING_LIMIT",
    "SURFACE_VELOCITY",
    "TORQUE_OVER_RADIUS",
    "VELOCITY",
    "clear_force_sums",
    "load_body_records",
    "store_body_records",
    "tool_record_row",
]

# Columns of a body record. Of a tool's record only the angular velocity is set.
DISPLACEMENT = 0
"""Displacement since the start of the step, map axes [m] (3)."""
CONTACT_RADIUS = 3
"""Contact radius [m]."""
VELOCITY = 4
"""Velocity, map axes [m/s] (3)."""
INVERSE_MASS = 7
"""Inverse mass [1/kg]; 0 while asleep or frozen."""
SURFACE_VELOCITY = 8
"""Angular velocity times contact radius, map axes [m/s] (3)."""
FULL_RADIUS = 11
"""Full radius [m]."""
ANGULAR_VELOCITY = 12
"""Angular velocity, map axes [rad/s] (3)."""
MASS_OVER_INERTIA = 15
"""Mass over moment of inertia [1/m^2]."""
BODY_RECORD_SIZE = 16

# Columns of the force sums.
FORCE = 0
"""Contact force, map axes [N] (3)."""
ROLLING_LIMIT = 3
"""Limit of the rolling resistance over the radius: sum of coefficient times normal force [N]."""
TORQUE_OVER_RADIUS = 4
"""Torque of friction over the contact radius, map axes [N] (3)."""
LIMIT_WEIGHTED_ANGULAR_VELOCITY = 12
"""Sum over contacts of the other body's angular velocity times rolling limit [N rad/s] (3)."""
FORCE_RECORD_SIZE = 16

_ZERO = np.float32(0.0)
_SPHERE_MASS_OVER_INERTIA = np.float32(2.5)
"""m r^2 / I of a solid sphere, whose moment of inertia is 0.4 m r^2."""


@helper(forceinline=True)
def tool_record_row(num_rows, tool):  # type: ignore[no-untyped-def]
    """Return the row of the record of tool number `tool` among `num_rows` rows."""
    return num_rows - 1 - tool


@helper(forceinline=True)
def clear_force_sums(force_sums, row):  # type: ignore[no-untyped-def]
    """Set the force sums of a row to zero."""
    for k in range(FORCE_RECORD_SIZE):
        force_sums[row, k] = _ZERO


@threaded_kernel
def load_body_records(  # type: ignore[no-untyped-def]
    rows, body, force_sums, velocity, angular_velocity, contact_radius, radius, inverse_mass,
    sleep_state,
):  # fmt: skip
    """Fill the body records of `rows` from the columns of `ParticleState`, clear their force sums.

    Args:
        rows: rows to fill, int64.
        body, force_sums: out, shapes (n, BODY_RECORD_SIZE), (n, FORCE_RECORD_SIZE), float32.
        velocity, angular_velocity, contact_radius, radius, inverse_mass, sleep_state: columns of
            `ParticleState`.
    """
    for c in prange(NUM_CHUNKS):
        _load_chunk(
            row_chunk(rows, c), body, force_sums, velocity, angular_velocity, contact_radius,
            radius, inverse_mass, sleep_state,
        )  # fmt: skip


@helper(forceinline=True)
def _load_chunk(  # type: ignore[no-untyped-def]
    rows, body, force_sums, velocity, angular_velocity, contact_radius, radius, inverse_mass,
    sleep_state,
):  # fmt: skip
    for k in range(rows.size):
        i = np.uint64(rows[k])
        turning = load_row(angular_velocity, i, 0)
        store_row(body, i, DISPLACEMENT, (_ZERO, _ZERO, _ZERO))
        store_row(body, i, VELOCITY, load_row(velocity, i, 0))
        store_row(body, i, SURFACE_VELOCITY, scale(turning, contact_radius[i]))
        store_row(body, i, ANGULAR_VELOCITY, turning)
        body[i, CONTACT_RADIUS], body[i, FULL_RADIUS] = contact_radius[i], radius[i]
        body[i, INVERSE_MASS] = inverse_mass[i] if sleep_state[i] == AWAKE else _ZERO
        body[i, MASS_OVER_INERTIA] = _SPHERE_MASS_OVER_INERTIA / (radius[i] * radius[i])
        clear_force_sums(force_sums, i)


@threaded_helper
def store_body_records(rows, body, position, velocity, angular_velocity):  # type: ignore[no-untyped-def]
    """Write the motion in the body records of `rows` to the columns of `ParticleState`."""
    for c in prange(NUM_CHUNKS):
        _store_chunk(row_chunk(rows, c), body, position, velocity, angular_velocity)


@kernel(forceinline=True)
def _store_chunk(rows, body, position, velocity, angular_velocity):  # type: ignore[no-untyped-def]
    for k in range(rows.size):
        i = np.uint64(rows[k])
        for axis in range(3):
            position[i, axis] += body[i, DISPLACEMENT + axis]
            velocity[i, axis] = body[i, VELOCITY + axis]
            angular_velocity[i, axis] = body[i, ANGULAR_VELOCITY + axis]
