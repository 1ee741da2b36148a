"""Released particles grow to size, so that a release into others is no explosion.

Soil comes loose as overlapping parcels. Each starts with a contact radius that overlaps nothing,
and grows in `growth_time` where it has room, slowly where it must push its neighbours away.
"""

from __future__ import annotations

import numpy as np

from machine_sim.dem.params import ParticleParams
from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import to_tool_frame
from msg_bridge.kernels import kernel

__all__ = ["grow_radii", "growth_per_step", "set_initial_radii"]

_MIN_RADIUS_FRACTION = np.float32(0.01)
"""Smallest contact radius, in radii: one released on another must push it somewhere."""
_COINCIDENT_SHIFT = 0.2
"""How far particles of one place are parted, in radii."""
_COINCIDENT_DISTANCE = 0.01
"""Centres nearer than this many radii are taken for one place."""
_FREE_GROWTH_OVERLAP = 0.01
"""Overlap, in sums of radii, up to which growth goes on at full speed."""
_MIN_GROWTH_FRACTION = 1.0 / 16.0
"""Share of the full growth speed that goes on against any pressure, so that all grow up."""


def growth_per_step(dt: float, params: ParticleParams) -> float:
    """How far a particle grows in a step of `dt` [s] at most, in radii."""
    return dt * (1.0 - params.release_radius_fraction) / max(params.growth_time, dt)


@kernel
def set_initial_radii(  # type: ignore[no-untyped-def]
    radius_fraction, first, second, num_pairs, position, radius, contact_radius, inverse_mass,
    plate_contacts, tools, ground_contacts,
):  # fmt: skip
    """Give each particle with contact radius 0 one that touches neither particle, plate nor ground.

    Frozen ones get the smallest: pairs of them are not listed, and what they overlap is not known.

    Args:
        share: largest contact radius to start with, in radii.
        first, second, pairs: the listed pairs.
        position, radius, contact_radius, inverse_mass: of the particles.
        walls, tools, grounds: `PlateCandidates`, `ToolMotion` and `GroundContacts`.
    """
    n = radius.size
    _separate_coincident(first, second, num_pairs, position, radius, contact_radius)
    free_radius = np.empty(n, np.float64)
    for i in range(n):
        free_radius[i] = radius_fraction * radius[i] if inverse_mass[i] > 0.0 else 0.0
    for k in range(num_pairs):
        i, j = first[k], second[k]
        fresh_i, fresh_j = contact_radius[i] == 0.0, contact_radius[j] == 0.0
        if fresh_i or fresh_j:
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            d = np.sqrt(dx * dx + dy * dy + dz * dz)
            if fresh_i and fresh_j:
                free_radius[i], free_radius[j] = (
                    min(free_radius[i], 0.5 * d),
                    min(free_radius[j], 0.5 * d),
                )
            elif fresh_i:
                free_radius[i] = min(free_radius[i], d - contact_radius[j])
            else:
                free_radius[j] = min(free_radius[j], d - contact_radius[i])
    for c in range(plate_contacts.row.size):
        i, k = plate_contacts.row[c], plate_contacts.plate[c]
        x, y, z = to_tool_frame(
            tools.path[0, tools.tool_of_plate[k]], position[i, 0], position[i, 1], position[i, 2]
        )
        a, b, h = plate_coordinates(tools.plates, k, x, y, z)
        ca, cb, _inside = closest_in_polygon(tools.plates, k, a, b)
        free_radius[i] = min(free_radius[i], np.sqrt((a - ca) ** 2 + (b - cb) ** 2 + h * h))
    plane = ground_contacts.plane
    for c in range(ground_contacts.row.size):
        i = ground_contacts.row[c]
        distance = plane[c, 0] * position[i, 0] + plane[c, 1] * position[i, 1]
        distance += plane[c, 2] * position[i, 2] - plane[c, 3]
        free_radius[i] = min(free_radius[i], distance)
    for i in range(n):
        if contact_radius[i] == 0.0:
            contact_radius[i] = max(np.float32(free_radius[i]), _MIN_RADIUS_FRACTION * radius[i])


@kernel
def _separate_coincident(first, second, num_pairs, position, radius, contact_radius):  # type: ignore[no-untyped-def]
    """Shift fresh particles that share one place, each its own way, so that they can part."""
    shifted = np.zeros(radius.size, np.bool_)
    for k in range(num_pairs):
        i, j = first[k], second[k]
        if contact_radius[j] != 0.0:
            i, j = j, i
        if contact_radius[j] != 0.0 or shifted[j]:
            continue
        d2 = 0.0
        for axis in range(3):
            d2 += (position[j, axis] - position[i, axis]) ** 2
        if d2 > (_COINCIDENT_DISTANCE * radius[j]) ** 2:
            continue
        shifted[j] = True
        # The R2 sequence of the plastic number spreads directions evenly: never two alike.
        z = 2.0 * ((0.7548776662466927 * j) % 1.0) - 1.0
        turn, across = 2.0 * np.pi * ((0.5698402909980532 * j) % 1.0), np.sqrt(1.0 - z * z)
        step = _COINCIDENT_SHIFT * radius[j]
        position[j, 0] += step * across * np.cos(turn)
        position[j, 1] += step * across * np.sin(turn)
        position[j, 2] += step * z


@kernel
def grow_radii(  # type: ignore[no-untyped-def]
    first, second, num_pairs, position, radius, contact_radius, inverse_mass, radius_fraction,
):  # fmt: skip
    """Let contact radii grow by up to `share` of the full radius.

    Those of frozen particles stay: pairs of them are not listed, they would grow into one another.

    Returns:
        How many are not full yet, frozen ones too: they grow once they are let go.
    """
    n = radius.size
    free_radius, grows = np.empty(n, np.float64), np.empty(n, np.bool_)
    for i in range(n):
        free_radius[i], grows[i] = radius_fraction * radius[i], contact_radius[i] < radius[i]
    # First which pairs, without branches: no processor guesses who grows.
    listed, count = np.empty(num_pairs, np.int64), 0
    for k in range(num_pairs):
        listed[count] = k
        count += grows[first[k]] | grows[second[k]]
    for k in listed[:count]:
        i, j = first[k], second[k]
        dx = position[j, 0] - position[i, 0]
        dy = position[j, 1] - position[i, 1]
        dz = position[j, 2] - position[i, 2]
        reach = contact_radius[i] + contact_radius[j]
        gap = np.sqrt(dx * dx + dy * dy + dz * dz) - reach + _FREE_GROWTH_OVERLAP * reach
        if grows[i] and grows[j]:
            gap *= 0.5
        # Of one that does not grow the room has no meaning.
        free_radius[i] = min(free_radius[i], gap)
        free_radius[j] = min(free_radius[j], gap)
    growing = 0
    for i in range(n):
        if contact_radius[i] < radius[i]:
            if inverse_mass[i] > 0.0:
                grown = contact_radius[i] + max(
                    free_radius[i], _MIN_GROWTH_FRACTION * radius_fraction * radius[i]
                )
                contact_radius[i] = min(np.float32(grown), radius[i])
            growing += contact_radius[i] < radius[i]
    return growing
