"""Released particles grow to size, so that a release into others is no explosion.

Soil comes loose as overlapping parcels. Each starts with a contact radius that overlaps nothing,
and grows in `growth_time` where it has room, slowly where it must push its neighbours away.
"""

from __future__ import annotations

import numpy as np

from machine_sim.jit import kernel
from machine_sim.particles.params import ParticleParams
from machine_sim.particles.plates import closest_in_polygon, plate_coordinates
from machine_sim.particles.pose import to_tool

__all__ = ["grow_radii", "growth_in", "start_radii"]

_LEAST = np.float32(0.01)
"""Smallest contact radius, in radii: one released on another must push it somewhere."""
_SHIFT = 0.2
"""How far particles of one place are parted, in radii."""
_COINCIDENT = 0.01
"""Centres nearer than this many radii are taken for one place."""
_PUSH = 0.01
"""Overlap, in sums of radii, up to which growth goes on at full speed."""
_CREEP = 1.0 / 16.0
"""Share of the full growth speed that goes on against any pressure, so that all grow up."""


def growth_in(dt: float, params: ParticleParams) -> float:
    """How far a particle grows in a step of `dt` [s] at most, in radii."""
    return dt * (1.0 - params.release_size) / max(params.growth_time, dt)


@kernel
def start_radii(  # type: ignore[no-untyped-def]
    share, first, second, pairs, position, radius, contact_radius, inverse_mass,
    walls, tools, grounds,
):  # fmt: skip
    """Give each particle with contact radius 0 one that touches neither particle, plate nor ground.

    Frozen ones get the smallest: pairs of them are not listed, and what they overlap is not known.

    Args:
        share: largest contact radius to start with, in radii.
        first, second, pairs: the listed pairs.
        position, radius, contact_radius, inverse_mass: of the particles.
        walls, tools, grounds: `ListedWalls`, `ToolMotion` and `GroundContacts`.
    """
    n = radius.size
    _part_coincident(first, second, pairs, position, radius, contact_radius)
    room = np.empty(n, np.float64)
    for i in range(n):
        room[i] = share * radius[i] if inverse_mass[i] > 0.0 else 0.0
    for k in range(pairs):
        i, j = first[k], second[k]
        fresh_i, fresh_j = contact_radius[i] == 0.0, contact_radius[j] == 0.0
        if fresh_i or fresh_j:
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            d = np.sqrt(dx * dx + dy * dy + dz * dz)
            if fresh_i and fresh_j:
                room[i], room[j] = min(room[i], 0.5 * d), min(room[j], 0.5 * d)
            elif fresh_i:
                room[i] = min(room[i], d - contact_radius[j])
            else:
                room[j] = min(room[j], d - contact_radius[i])
    for c in range(walls.row.size):
        i, k = walls.row[c], walls.plate[c]
        x, y, z = to_tool(
            tools.path[0, tools.owner[k]], position[i, 0], position[i, 1], position[i, 2]
        )
        a, b, h = plate_coordinates(tools.plates, k, x, y, z)
        ca, cb, _inside = closest_in_polygon(tools.plates, k, a, b)
        room[i] = min(room[i], np.sqrt((a - ca) ** 2 + (b - cb) ** 2 + h * h))
    plane = grounds.plane
    for c in range(grounds.row.size):
        i = grounds.row[c]
        distance = plane[c, 0] * position[i, 0] + plane[c, 1] * position[i, 1]
        distance += plane[c, 2] * position[i, 2] - plane[c, 3]
        room[i] = min(room[i], distance)
    for i in range(n):
        if contact_radius[i] == 0.0:
            contact_radius[i] = max(np.float32(room[i]), _LEAST * radius[i])


@kernel
def _part_coincident(first, second, pairs, position, radius, contact_radius):  # type: ignore[no-untyped-def]
    """Shift fresh particles that share one place, each its own way, so that they can part."""
    shifted = np.zeros(radius.size, np.bool_)
    for k in range(pairs):
        i, j = first[k], second[k]
        if contact_radius[j] != 0.0:
            i, j = j, i
        if contact_radius[j] != 0.0 or shifted[j]:
            continue
        d2 = 0.0
        for axis in range(3):
            d2 += (position[j, axis] - position[i, axis]) ** 2
        if d2 > (_COINCIDENT * radius[j]) ** 2:
            continue
        shifted[j] = True
        # The R2 sequence of the plastic number spreads directions evenly: never two alike.
        z = 2.0 * ((0.7548776662466927 * j) % 1.0) - 1.0
        turn, across = 2.0 * np.pi * ((0.5698402909980532 * j) % 1.0), np.sqrt(1.0 - z * z)
        step = _SHIFT * radius[j]
        position[j, 0] += step * across * np.cos(turn)
        position[j, 1] += step * across * np.sin(turn)
        position[j, 2] += step * z


@kernel
def grow_radii(  # type: ignore[no-untyped-def]
    first, second, pairs, position, radius, contact_radius, inverse_mass, share,
):  # fmt: skip
    """Let contact radii grow by up to `share` of the full radius.

    Those of frozen particles stay: pairs of them are not listed, they would grow into one another.

    Returns:
        How many are not full yet, frozen ones too: they grow once they are let go.
    """
    n = radius.size
    room, grows = np.empty(n, np.float64), np.empty(n, np.bool_)
    for i in range(n):
        room[i], grows[i] = share * radius[i], contact_radius[i] < radius[i]
    # First which pairs, without branches: no processor guesses who grows.
    listed, count = np.empty(pairs, np.int64), 0
    for k in range(pairs):
        listed[count] = k
        count += grows[first[k]] | grows[second[k]]
    for k in listed[:count]:
        i, j = first[k], second[k]
        dx = position[j, 0] - position[i, 0]
        dy = position[j, 1] - position[i, 1]
        dz = position[j, 2] - position[i, 2]
        reach = contact_radius[i] + contact_radius[j]
        gap = np.sqrt(dx * dx + dy * dy + dz * dz) - reach + _PUSH * reach
        if grows[i] and grows[j]:
            gap *= 0.5
        # Of one that does not grow the room has no meaning.
        room[i] = min(room[i], gap)
        room[j] = min(room[j], gap)
    growing = 0
    for i in range(n):
        if contact_radius[i] < radius[i]:
            if inverse_mass[i] > 0.0:
                grown = contact_radius[i] + max(room[i], _CREEP * share * radius[i])
                contact_radius[i] = min(np.float32(grown), radius[i])
            growing += contact_radius[i] < radius[i]
    return growing
