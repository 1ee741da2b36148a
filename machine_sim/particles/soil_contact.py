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

from machine_sim.ground import surface_at
from machine_sim.jit import kernel, threaded_kernel
from machine_sim.particles.law import contact_force
from machine_sim.particles.parts import CHUNKS, chunk

__all__ = ["GroundContacts", "finish_on_ground", "ground_forces", "ground_planes"]

_SOFT_PUSH = 100.0
"""Largest spring acceleration the ground gives a soft particle [m/s^2]."""
_STEEP = 10.0
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
def ground_planes(  # type: ignore[no-untyped-def]
    surface, ground, dt, law, rows, inside, near, position, velocity, radius, contact_radius, soft,
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
    found = np.zeros(CHUNKS, np.int64)
    for c in prange(CHUNKS):
        low, high = c * rows.size // CHUNKS, (c + 1) * rows.size // CHUNKS
        found[c] = _planes_of(
            surface, ground, dt, law, rows[low:high], inside[low:high], near[low:high], position,
            velocity, radius, contact_radius, soft, spring, row[low:high], plane[low:high],
        )  # fmt: skip
    count = 0
    for c in range(CHUNKS):
        low = c * rows.size // CHUNKS
        for k in range(found[c]):
            row[count + k] = row[low + k]
            for axis in range(4):
                plane[count + k, axis] = plane[low + k, axis]
        count += found[c]
    return count


@kernel
def _planes_of(  # type: ignore[no-untyped-def]
    surface, ground, dt, law, rows, inside, near, position, velocity, radius, contact_radius, soft,
    spring, row, plane,
):  # fmt: skip
    count = 0
    soft_overlap = _SOFT_PUSH / np.float64(law[0])
    for k in range(rows.size):
        if inside[k]:
            continue
        i = rows[k]
        was_soft = soft[i]
        soft[i] = near[k]
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        r = np.float64(radius[i])
        speed2 = velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2
        reach = 1.2 * r + 1.3 * dt * np.sqrt(speed2)
        height, slope_x, slope_y = surface_at(surface, ground[0], ground[1], ground[2], x, y)
        above = z - height
        steep = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        if above > max(_STEEP * r, reach) and above > reach * steep:
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
        soft[i] = near[k] or (was_soft and contact_radius[i] - above * nz > soft_overlap)
        nx, ny = -slope_x * nz, -slope_y * nz
        row[count] = i
        plane[count, 0], plane[count, 1], plane[count, 2] = nx, ny, nz
        plane[count, 3] = nx * x + ny * y + nz * height
        count += 1
    return count


@kernel
def ground_forces(  # type: ignore[no-untyped-def]
    low, high, grounds, position, mass, soft, spring, body, total, law, friction, rolling
):
    """Add the ground's forces to `total`, and carry the tangential springs on.

    Of the contacts from number `low` to below `high`.
    """
    row, plane = grounds.row, grounds.plane
    soft_overlap = _SOFT_PUSH / np.float64(law[0])
    for c in range(low, high):
        i = row[c]
        nx, ny, nz = plane[c, 0], plane[c, 1], plane[c, 2]
        distance = nx * (position[i, 0] + body[i, 0]) + ny * (position[i, 1] + body[i, 1])
        distance += nz * (position[i, 2] + body[i, 2]) - plane[c, 3]
        r = np.float64(body[i, 3])
        # One radius at most: deeper is for `finish_on_ground`.
        overlap = min(r - distance, r)
        if overlap <= 0.0:
            spring[i, 0] = spring[i, 1] = spring[i, 2] = np.float32(0.0)
            continue
        if soft[i]:
            overlap = min(overlap, soft_overlap)
        ax, ay, az = body[i, 8], body[i, 9], body[i, 10]
        push, gx, gy, gz, sx, sy, sz = contact_force(
            law, friction, overlap, nx, ny, nz,
            body[i, 4] - (ay * nz - az * ny),
            body[i, 5] - (az * nx - ax * nz),
            body[i, 6] - (ax * ny - ay * nx),
            spring[i, 0], spring[i, 1], spring[i, 2],
        )  # fmt: skip
        spring[i, 0], spring[i, 1], spring[i, 2] = sx, sy, sz
        m = mass[i]
        total[i, 0] += m * (push * nx + gx)
        total[i, 1] += m * (push * ny + gy)
        total[i, 2] += m * (push * nz + gz)
        total[i, 3] += m * push * rolling
        total[i, 4] += m * (gy * nz - gz * ny)
        total[i, 5] += m * (gz * nx - gx * nz)
        total[i, 6] += m * (gx * ny - gy * nx)


@threaded_kernel
def finish_on_ground(  # type: ignore[no-untyped-def]
    surface, ground, dt, settle_speed, rows, grounds,
    position, velocity, radius, soft, quiet_time,
):  # fmt: skip
    """Bring back who sank through the ground, and time who is slow on it.

    A centre more than a radius under the surface is put back upon it at rest. A particle is on
    the ground when its centre is within sqrt(3)/2 diameters of it (half the diagonal of a cube of
    that size, the rule for cubes).

    Returns:
        How many were brought back.
    """
    row, plane = grounds.row, grounds.plane
    rescued = np.zeros(CHUNKS, np.int64)
    for c in prange(CHUNKS):
        _time_quiet(dt, settle_speed, chunk(rows, c), velocity, quiet_time)
    for c in prange(CHUNKS):
        rescued[c] = _finish(
            surface, ground, chunk(row, c), plane[c * row.size // CHUNKS :], position,
            velocity, radius, soft, quiet_time,
        )  # fmt: skip
    # Whoever was not slow and on the ground has a negative or no time now.
    for c in prange(CHUNKS):
        _clear_negative(chunk(rows, c), quiet_time)
    return rescued.sum()


@kernel
def _time_quiet(dt, settle_speed, rows, velocity, quiet_time):  # type: ignore[no-untyped-def]
    """Add to the time of who is slow, as a negative one until it is seen to be on the ground."""
    for i in rows:
        speed2 = velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2
        quiet_time[i] = -quiet_time[i] - np.float32(dt) if speed2 < settle_speed**2 else 0.0


@kernel
def _clear_negative(rows, quiet_time):  # type: ignore[no-untyped-def]
    for i in rows:
        quiet_time[i] = max(quiet_time[i], np.float32(0.0))


@kernel
def _finish(surface, ground, row, plane, position, velocity, radius, soft, quiet_time):  # type: ignore[no-untyped-def]
    """Bring back who sank of those listed, and keep the time of who is on the ground."""
    rescued = 0
    for c in range(row.size):
        i = row[c]
        r = np.float64(radius[i])
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        height = _height(surface, ground, x, y)
        distance = (z - height) * plane[c, 2]
        if distance < -r and not soft[i]:
            position[i, 2] = height + r / plane[c, 2]
            velocity[i, 0] = velocity[i, 1] = velocity[i, 2] = 0.0
            rescued += 1
            distance = r
        if distance <= np.sqrt(3.0) * r:
            quiet_time[i] = -quiet_time[i]
    return rescued
