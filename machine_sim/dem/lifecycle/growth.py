"""Growth of released particles to full size, so that a release into others is no explosion.

Soil comes loose as overlapping parcels. Each particle starts with a contact radius that overlaps
nothing. It grows in `growth_time` where it has room, slowly where it must push its neighbours away.
"""

from __future__ import annotations

import numpy as np

from machine_sim.dem.params import ParticleParams
from machine_sim.dem.tools.plane import signed_distance
from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import to_tool_frame
from msg_bridge.kernels import helper

__all__ = ["grow_radii", "growth_per_step", "set_initial_radii"]

_MIN_RADIUS_FRACTION = np.float32(0.01)
"""Minimum contact radius, in radii: a particle released inside another must push it somewhere."""
_COINCIDENT_SHIFT = 0.2
"""Displacement that separates coincident particles, in radii."""
_COINCIDENT_DISTANCE = 0.01
"""Maximum distance of the centres of coincident particles, in radii."""
_FREE_GROWTH_OVERLAP = 0.01
"""Overlap, in sums of radii, up to which a particle grows at full speed."""
_MIN_GROWTH_FRACTION = 1.0 / 16.0
"""Fraction of the full growth speed that is kept against any pressure, so that growth ends."""


def growth_per_step(dt: float, params: ParticleParams) -> float:
    """Return the maximum growth of a particle in a step of `dt` [s], in radii."""
    return dt * (1.0 - params.release_radius_fraction) / max(params.growth_time, dt)


@helper(allocates=True)
def set_initial_radii(  # type: ignore[no-untyped-def]
    max_fraction, first, second, view, plate_contacts, tools, ground_contacts
):
    """Set contact radii that are 0 so that they touch neither particle, plate nor ground.

    Frozen particles get the minimum: their pairs with each other are not listed, so that their
    overlaps are not known.

    Args:
        max_fraction: maximum initial contact radius, in radii.
        first, second: rows of the listed pairs, shape (pairs,).
        view: `ParticleColumns`; contact radii are set, and coincident particles separated.
        plate_contacts, tools, ground_contacts: `PlateCandidates`, `ToolMotion`, `GroundContacts`.
    """
    radius, contact_radius = view.radius, view.contact_radius
    n = radius.size
    _separate_coincident(first, second, view)
    free_radius = np.empty(n, np.float64)
    for i in range(n):
        free_radius[i] = max_fraction * radius[i] if view.inverse_mass[i] > 0.0 else 0.0
    _limit_by_pairs(first, second, view, free_radius)
    _limit_by_boundaries(view.position, plate_contacts, tools, ground_contacts, free_radius)
    for i in range(n):
        if contact_radius[i] == 0.0:
            contact_radius[i] = max(np.float32(free_radius[i]), _MIN_RADIUS_FRACTION * radius[i])


@helper
def _limit_by_pairs(first, second, view, free_radius):  # type: ignore[no-untyped-def]
    """Limit the free radius [m] of each unsized particle to the gap to its neighbours."""
    position, contact_radius = view.position, view.contact_radius
    for k in range(first.size):
        i, j = first[k], second[k]
        is_unsized_i, is_unsized_j = contact_radius[i] == 0.0, contact_radius[j] == 0.0
        if is_unsized_i or is_unsized_j:
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            d = np.sqrt(dx * dx + dy * dy + dz * dz)
            if is_unsized_i and is_unsized_j:
                free_radius[i] = min(free_radius[i], 0.5 * d)
                free_radius[j] = min(free_radius[j], 0.5 * d)
            elif is_unsized_i:
                free_radius[i] = min(free_radius[i], d - contact_radius[j])
            else:
                free_radius[j] = min(free_radius[j], d - contact_radius[i])


@helper
def _limit_by_boundaries(position, plate_contacts, tools, ground_contacts, free_radius):  # type: ignore[no-untyped-def]
    """Limit free radii [m] to the distances to plates, at the step's start, and to the ground."""
    for c in range(plate_contacts.row.size):
        i, k = plate_contacts.row[c], plate_contacts.plate[c]
        x, y, z = to_tool_frame(
            tools.path[0, tools.tool_of_plate[k]], position[i, 0], position[i, 1], position[i, 2]
        )
        a, b, h = plate_coordinates(tools.plates, k, x, y, z)
        ca, cb, _ = closest_in_polygon(tools.plates, k, a, b)
        free_radius[i] = min(free_radius[i], np.sqrt((a - ca) ** 2 + (b - cb) ** 2 + h * h))
    for c in range(ground_contacts.row.size):
        i = ground_contacts.row[c]
        distance = signed_distance(
            ground_contacts.plane[c], position[i, 0], position[i, 1], position[i, 2]
        )
        free_radius[i] = min(free_radius[i], distance)


@helper(allocates=True)
def _separate_coincident(first, second, view):  # type: ignore[no-untyped-def]
    """Displace coincident unsized particles, each in its own direction, so that they can part."""
    position, radius, contact_radius = view.position, view.radius, view.contact_radius
    is_shifted = np.zeros(radius.size, np.bool_)
    for k in range(first.size):
        i, j = first[k], second[k]
        if contact_radius[j] != 0.0:
            i, j = j, i
        if contact_radius[j] != 0.0 or is_shifted[j]:
            continue
        distance2 = 0.0
        for axis in range(3):
            distance2 += (position[j, axis] - position[i, axis]) ** 2
        if distance2 > (_COINCIDENT_DISTANCE * radius[j]) ** 2:
            continue
        is_shifted[j] = True
        # The R2 sequence of the plastic number spreads directions evenly: no two are the same.
        z = 2.0 * ((0.7548776662466927 * j) % 1.0) - 1.0
        azimuth = 2.0 * np.pi * ((0.5698402909980532 * j) % 1.0)
        horizontal = np.sqrt(1.0 - z * z)
        shift = _COINCIDENT_SHIFT * radius[j]
        position[j, 0] += shift * horizontal * np.cos(azimuth)
        position[j, 1] += shift * horizontal * np.sin(azimuth)
        position[j, 2] += shift * z


@helper(allocates=True)
def grow_radii(max_growth, first, second, view):  # type: ignore[no-untyped-def]
    """Grow contact radii that are below the full radius.

    The radii of frozen particles stay: their pairs with each other are not listed, so that they
    would grow into one another.

    Args:
        max_growth: maximum growth in this step, in radii.
        first, second: rows of the listed pairs, shape (pairs,).
        view: `ParticleColumns`; contact radii are updated.

    Returns:
        Number of particles that are still growing, with frozen ones: they grow once unfrozen.
    """
    position, radius, contact_radius = view.position, view.radius, view.contact_radius
    n = radius.size
    free_growth, is_growing = np.empty(n, np.float64), np.empty(n, np.bool_)
    for i in range(n):
        free_growth[i] = max_growth * radius[i]
        is_growing[i] = contact_radius[i] < radius[i]
    # The pairs are selected in a loop without branches, which no processor could predict.
    selected, count = np.empty(first.size, np.uint32), np.uint64(0)
    for k in range(first.size):
        selected[count] = k
        count += np.uint64(is_growing[first[k]] | is_growing[second[k]])
    for k in selected[:count]:
        i, j = first[k], second[k]
        dx = position[j, 0] - position[i, 0]
        dy = position[j, 1] - position[i, 1]
        dz = position[j, 2] - position[i, 2]
        reach = contact_radius[i] + contact_radius[j]
        gap = np.sqrt(dx * dx + dy * dy + dz * dz) - reach + _FREE_GROWTH_OVERLAP * reach
        if is_growing[i] and is_growing[j]:
            gap *= 0.5
        # The value of a particle that does not grow is not used.
        free_growth[i] = min(free_growth[i], gap)
        free_growth[j] = min(free_growth[j], gap)
    num_growing = 0
    for i in range(n):
        if contact_radius[i] < radius[i]:
            if view.inverse_mass[i] > 0.0:
                min_growth = _MIN_GROWTH_FRACTION * max_growth * radius[i]
                grown = contact_radius[i] + max(free_growth[i], min_growth)
                contact_radius[i] = min(np.float32(grown), radius[i])
            num_growing += contact_radius[i] < radius[i]
    return num_growing
