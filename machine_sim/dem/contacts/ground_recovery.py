"""End of a step on the ground: recovery of particles that sank through it, and settle timers."""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.dem.contacts.ground_contacts import terrain_height
from machine_sim.dem.partition import NUM_CHUNKS, row_chunk
from machine_sim.dem.tools.plane import PLANE_NORMAL, signed_distance
from machine_sim.dem.vec3 import dot, load_row, store_row
from msg_bridge.kernels import helper, threaded_helper

__all__ = ["recover_and_time_settling"]

_SETTLED_DISTANCE = np.sqrt(3.0)
"""Distance of a centre from the ground below which the particle lies on it, in radii: half the
diagonal of a cube of the particle's diameter, the rule for cubes."""


@threaded_helper
def recover_and_time_settling(  # type: ignore[no-untyped-def]
    surface, frame, dt, settle_speed, rows, contacts, particles
):
    """Put particles that sank through the ground back onto it, and update the settle timers.

    A centre more than a radius below the surface is put back onto it at rest, unless its contact is
    penetration-limited. The settle timer of a particle slower than `settle_speed` [m/s] on the
    ground grows by `dt` [s]; that of any other is reset. The ground overlaps are updated.

    Args:
        surface, frame: arrays of `Ground`.
        dt: length of the step that ends [s].
        settle_speed: [m/s].
        rows: particles moved by forces.
        contacts: `GroundContacts` of the step.
        particles: `ParticleColumns`; updated.

    Returns:
        Number of particles put back.
    """
    row, plane = contacts.row, contacts.plane
    position, velocity, radius = particles.position, particles.velocity, particles.radius
    contact_radius, penetration_limited = particles.contact_radius, particles.penetration_limited
    ground_overlap, settle_timer = particles.ground_overlap, particles.settle_timer
    num_recovered = np.zeros(NUM_CHUNKS, np.int64)
    for c in prange(NUM_CHUNKS):
        _advance_settle_timers(dt, settle_speed, row_chunk(rows, c), velocity, settle_timer)
    for c in prange(NUM_CHUNKS):
        num_recovered[c] = _recover_chunk(
            surface, frame, row_chunk(row, c), plane[c * row.size // NUM_CHUNKS :], position,
            velocity, radius, contact_radius, penetration_limited, ground_overlap, settle_timer,
        )  # fmt: skip
    # Timers of slow particles that are not on the ground are still negative.
    for c in prange(NUM_CHUNKS):
        _clear_airborne_timers(row_chunk(rows, c), settle_timer)
    return num_recovered.sum()


@helper(forceinline=True)
def _advance_settle_timers(dt, settle_speed, rows, velocity, settle_timer):  # type: ignore[no-untyped-def]
    """Advance the timers of slow particles, negated until the particle is found on the ground."""
    for i in rows:
        speed2 = dot(load_row(velocity, i, 0), load_row(velocity, i, 0))
        settle_timer[i] = -settle_timer[i] - np.float32(dt) if speed2 < settle_speed**2 else 0.0


@helper(forceinline=True)
def _clear_airborne_timers(rows, settle_timer):  # type: ignore[no-untyped-def]
    for i in rows:
        settle_timer[i] = max(settle_timer[i], np.float32(0.0))


@helper(forceinline=True)
def _recover_chunk(  # type: ignore[no-untyped-def]
    surface, frame, row, plane, position, velocity, radius, contact_radius, penetration_limited,
    ground_overlap, settle_timer,
):  # fmt: skip
    """Put back the listed particles that sank, and keep the timers of those on the ground.

    The overlap with the plane of the step is stored, for comparison with that at the next start.

    Returns:
        Number of particles put back.
    """
    num_recovered = 0
    for c in range(row.size):
        i = row[c]
        r = np.float64(radius[i])
        x, y, z = load_row(position, i, 0)
        height = terrain_height(surface, frame, x, y)
        nz = plane[c, PLANE_NORMAL + 2]
        distance = (z - height) * nz
        if distance < -r and not penetration_limited[i]:
            position[i, 2] = height + r / nz
            store_row(velocity, i, 0, (0.0, 0.0, 0.0))
            num_recovered += 1
            distance = r
        ground_overlap[i] = contact_radius[i] - signed_distance(plane[c], *load_row(position, i, 0))
        if distance <= _SETTLED_DISTANCE * r:
            settle_timer[i] = -settle_timer[i]
    return num_recovered
