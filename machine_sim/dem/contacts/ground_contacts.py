"""Particles on the terrain: a tangent plane per particle and step, forces, rest and rescue.

Each particle near the ground feels, for one step, the plane that fits the terrain under it. The
slope is taken across its own diameter: a bilinear surface has creases between columns, and a
normal that jumps there would fire a particle off the foot of a cliff.

Beside a tool the surface is known only as the mean of columns that are partly cut: the face ahead
of a bucket's lip is smeared over a column or two, and soil in the lip's way seems to lie deep
under it. Particles there are *soft*: the ground pushes them out gently and never puts them back.
One that leaves the tool while the ground still covers it stays soft until it is out: the full push
on so deep a particle would fire it off.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from machine_sim.dem.contacts.contact_law import contact_force
from machine_sim.dem.partition import NUM_CHUNKS, row_chunk
from machine_sim.ground.contact_surface import surface_at
from msg_bridge.kernels import kernel, threaded_kernel

__all__ = ["GroundContacts", "finish_ground_contacts", "ground_forces", "list_ground_contacts"]

_MAX_LIMITED_ACCELERATION = 100.0
"""Largest spring acceleration the ground gives a soft particle [m/s^2]."""
_CLIFF_CLEARANCE = 10.0
"""Height over the ground, in radii, above which a centre is clear of any cliff beside it."""


@kernel
def _height(surface, ground, x, y):  # type: ignore[no-untyped-def]
    """Terrain height [m] at (x, y)."""
    return surface_at(surface, ground[0], ground[1], ground[2], x, y)[0]


class GroundContacts(NamedTuple):
    """Who may touch the ground within a step, and the plane each feels.

    Attributes:
        row: of the particles, int64, shape (n,).
        plane: normal and offset [m], shape (n, 4): distance = normal.x - offset.
    """

    row: NDArray[np.int64]
    plane: NDArray[np.float64]


@threaded_kernel
def list_ground_contacts(  # type: ignore[no-untyped-def]
    surface, ground, dt, contact_params, rows, inside, near, position, velocity, radius, contact_radius, penetration_limited,
    spring, row, plane,
):  # fmt: skip
    """List the particles that may touch the ground within `dt` [s] and the plane each feels.

    Args:
        surface, ground: contact surface [m] and `Ground.frame`.
        law: contact law.
        rows: who may move.
        inside, near: whether each of these is in a tool, and beside one.
        position, velocity, radius, contact_radius, spring: of the particles; springs out of touch
            reset.
        soft: in and out; a particle that is not near stays soft while it lies so deep that the
            full push would be a harder one.
        row, plane: out, as in `GroundContacts`.

    Returns:
        How many are listed.
    """
    found = np.zeros(NUM_CHUNKS, np.int64)
    for c in prange(NUM_CHUNKS):
        low, high = c * rows.size // NUM_CHUNKS, (c + 1) * rows.size // NUM_CHUNKS
        found[c] = _fit_planes(
            surface, ground, dt, contact_params, rows[low:high], inside[low:high], near[low:high], position,
            velocity, radius, contact_radius, penetration_limited, spring, row[low:high], plane[low:high],
        )  # fmt: skip
    count = 0
    for c in range(NUM_CHUNKS):
        low = c * rows.size // NUM_CHUNKS
        for k in range(found[c]):
            row[count + k] = row[low + k]
            for axis in range(4):
                plane[count + k, axis] = plane[low + k, axis]
        count += found[c]
    return count


@kernel
def _fit_planes(  # type: ignore[no-untyped-def]
    surface, ground, dt, contact_params, rows, inside, near, position, velocity, radius, contact_radius, penetration_limited,
    spring, row, plane,
):  # fmt: skip
    count = 0
    max_penetration = _MAX_LIMITED_ACCELERATION / np.float64(contact_params[0])
    for k in range(rows.size):
        if inside[k]:
            continue
        i = rows[k]
        was_limited = penetration_limited[i]
        penetration_limited[i] = near[k]
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        r = np.float64(radius[i])
        speed2 = velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2
        reach = 1.2 * r + 1.3 * dt * np.sqrt(speed2)
        height, slope_x, slope_y = surface_at(surface, ground[0], ground[1], ground[2], x, y)
        above = z - height
        steep = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        if above > max(_CLIFF_CLEARANCE * r, reach) and above > reach * steep:
            spring[i, 0] = spring[i, 1] = spring[i, 2] = np.float32(0.0)
            continue
        slope_x = (_height(surface, ground, x + r, y) - _height(surface, ground, x - r, y)) / (
            2 * r
        )
        slope_y = (_height(surface, ground, x, y + r) - _height(surface, ground, x, y - r)) / (
            2 * r
        )
        nz = 1.0 / np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        if above * nz > reach:
            spring[i, 0] = spring[i, 1] = spring[i, 2] = np.float32(0.0)
            continue
        penetration_limited[i] = near[k] or (
            was_limited and contact_radius[i] - above * nz > max_penetration
        )
        nx, ny = -slope_x * nz, -slope_y * nz
        row[count] = i
        plane[count, 0], plane[count, 1], plane[count, 2] = nx, ny, nz
        plane[count, 3] = nx * x + ny * y + nz * height
        count += 1
    return count


@kernel
def ground_forces(  # type: ignore[no-untyped-def]
    low,
    high,
    ground_contacts,
    position,
    mass,
    penetration_limited,
    spring,
    body,
    force_sums,
    contact_params,
    friction,
    rolling_friction,
):
    """Add the ground's forces to `total`, and carry the tangential springs on.

    Of the contacts from number `low` to below `high`.
    """
    row, plane = ground_contacts.row, ground_contacts.plane
    max_penetration = _MAX_LIMITED_ACCELERATION / np.float64(contact_params[0])
    for c in range(low, high):
        i = row[c]
        nx, ny, nz = plane[c, 0], plane[c, 1], plane[c, 2]
        distance = nx * (position[i, 0] + body[i, 0]) + ny * (position[i, 1] + body[i, 1])
        distance += nz * (position[i, 2] + body[i, 2]) - plane[c, 3]
        r = np.float64(body[i, 3])
        # One radius at most: deeper is for `finish_ground_contacts`.
        overlap = min(r - distance, r)
        if overlap <= 0.0:
            spring[i, 0] = spring[i, 1] = spring[i, 2] = np.float32(0.0)
            continue
        if penetration_limited[i]:
            overlap = min(overlap, max_penetration)
        ax, ay, az = body[i, 8], body[i, 9], body[i, 10]
        normal_force, gx, gy, gz, sx, sy, sz = contact_force(
            contact_params, friction, overlap, nx, ny, nz,
            body[i, 4] - (ay * nz - az * ny),
            body[i, 5] - (az * nx - ax * nz),
            body[i, 6] - (ax * ny - ay * nx),
            spring[i, 0], spring[i, 1], spring[i, 2],
        )  # fmt: skip
        spring[i, 0], spring[i, 1], spring[i, 2] = sx, sy, sz
        m = mass[i]
        force_sums[i, 0] += m * (normal_force * nx + gx)
        force_sums[i, 1] += m * (normal_force * ny + gy)
        force_sums[i, 2] += m * (normal_force * nz + gz)
        force_sums[i, 3] += m * normal_force * rolling_friction
        force_sums[i, 4] += m * (gy * nz - gz * ny)
        force_sums[i, 5] += m * (gz * nx - gx * nz)
        force_sums[i, 6] += m * (gx * ny - gy * nx)


@threaded_kernel
def finish_ground_contacts(  # type: ignore[no-untyped-def]
    surface, ground, dt, settle_speed, rows, ground_contacts,
    position, velocity, radius, penetration_limited, settle_timer,
):  # fmt: skip
    """Bring back who sank through the ground, and time who is slow on it.

    A centre more than a radius under the surface is put back upon it at rest. A particle is on
    the ground when its centre is within sqrt(3)/2 diameters of it (half the diagonal of a cube of
    that size, the rule for cubes).

    Returns:
        How many were brought back.
    """
    row, plane = ground_contacts.row, ground_contacts.plane
    num_recovered = np.zeros(NUM_CHUNKS, np.int64)
    for c in prange(NUM_CHUNKS):
        _advance_settle_timers(dt, settle_speed, row_chunk(rows, c), velocity, settle_timer)
    for c in prange(NUM_CHUNKS):
        num_recovered[c] = _recover_sunken(
            surface, ground, row_chunk(row, c), plane[c * row.size // NUM_CHUNKS :], position,
            velocity, radius, penetration_limited, settle_timer,
        )  # fmt: skip
    # Whoever was not slow and on the ground has a negative or no time now.
    for c in prange(NUM_CHUNKS):
        _clear_airborne_timers(row_chunk(rows, c), settle_timer)
    return num_recovered.sum()


@kernel
def _advance_settle_timers(dt, settle_speed, rows, velocity, settle_timer):  # type: ignore[no-untyped-def]
    """Add to the time of who is slow, as a negative one until it is seen to be on the ground."""
    for i in rows:
        speed2 = velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2
        settle_timer[i] = -settle_timer[i] - np.float32(dt) if speed2 < settle_speed**2 else 0.0


@kernel
def _clear_airborne_timers(rows, settle_timer):  # type: ignore[no-untyped-def]
    for i in rows:
        settle_timer[i] = max(settle_timer[i], np.float32(0.0))


@kernel
def _recover_sunken(  # type: ignore[no-untyped-def]
    surface, ground, row, plane, position, velocity, radius, penetration_limited, settle_timer
):
    """Bring back who sank of those listed, and keep the time of who is on the ground."""
    num_recovered = 0
    for c in range(row.size):
        i = row[c]
        r = np.float64(radius[i])
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        height = _height(surface, ground, x, y)
        distance = (z - height) * plane[c, 2]
        if distance < -r and not penetration_limited[i]:
            position[i, 2] = height + r / plane[c, 2]
            velocity[i, 0] = velocity[i, 1] = velocity[i, 2] = 0.0
            num_recovered += 1
            distance = r
        if distance <= np.sqrt(3.0) * r:
            settle_timer[i] = -settle_timer[i]
    return num_recovered
