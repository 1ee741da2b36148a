"""Skins and sizes: how far a pair list looks ahead of each particle, and when that is used up."""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.jit import inline_kernel, kernel, threaded_kernel
from machine_sim.particles.parts import CHUNKS, chunk

__all__ = ["ROOM", "STEPS", "grow_ahead", "is_worn", "lay_skins"]

STEPS = 5.0
"""For how many steps a list should hold where particles move."""
ROOM = 1.3
"""Room for acceleration: how far ahead a particle is looked for, over how far it comes."""


@threaded_kernel
def is_worn(  # type: ignore[no-untyped-def]
    rows, every, position, velocity, origin, skins, contact_radius, radius, sizes, start, growth, dt
):
    """Whether one of `rows` may leave its skin or outgrow its size within the next step.

    Seen from the mean motion where they are all there are.
    """
    way = np.zeros((CHUNKS, 3))
    if every:
        for c in prange(CHUNKS):
            _add_up(chunk(rows, c), position, velocity, origin, dt, way[c])
    mean = np.zeros(3)
    for c in range(CHUNKS):
        for axis in range(3):
            mean[axis] += way[c, axis] / rows.size
    worn = np.zeros(CHUNKS, np.bool_)
    for c in prange(CHUNKS):
        part = chunk(rows, c)
        worn[c] = _leaves(part, position, velocity, origin, skins, dt, mean) or _outgrows(
            part, contact_radius, radius, sizes, start, growth
        )
    return worn.any()


@kernel
def _add_up(rows, position, velocity, origin, dt, way):  # type: ignore[no-untyped-def]
    for i in rows:
        for axis in range(3):
            way[axis] += position[i, axis] - origin[i, axis] + dt * velocity[i, axis]


@kernel
def _leaves(rows, position, velocity, origin, skins, dt, mean):  # type: ignore[no-untyped-def]
    for i in rows:
        dx = position[i, 0] - origin[i, 0] + dt * velocity[i, 0] - mean[0]
        dy = position[i, 1] - origin[i, 1] + dt * velocity[i, 1] - mean[1]
        dz = position[i, 2] - origin[i, 2] + dt * velocity[i, 2] - mean[2]
        if dx * dx + dy * dy + dz * dz > skins[i] * skins[i]:
            return True
    return False


@kernel
def _outgrows(rows, contact_radius, radius, sizes, start, growth):  # type: ignore[no-untyped-def]
    found = False
    for i in rows:
        found |= _grown(contact_radius[i], radius[i], start, growth) > sizes[i]
    return found


@kernel
def grow_ahead(contact_radius, radius, start, growth, sizes):  # type: ignore[no-untyped-def]
    """Fill `sizes` with what contact radii grow to [m]."""
    for i in range(sizes.size):
        sizes[i] = _grown(contact_radius[i], radius[i], start, growth)


@inline_kernel
def _grown(contact_radius, radius, start, growth):  # type: ignore[no-untyped-def]
    """Contact radius after growing by `growth` radii; one just released starts at up to `start`."""
    least = contact_radius if contact_radius > 0.0 else start * radius
    return min(least + growth * radius, np.float64(radius))


@kernel
def lay_skins(rows, every, velocity, dt, base, longest, most_strays, skins):  # type: ignore[no-untyped-def]
    """Fill the `skins` of `rows` [m]: `base`, and the way relative to the mean in some steps.

    `STEPS` of them, fewer where more than `most_strays` would go farther than `longest`, but one
    at least.

    Returns:
        The longest skin of those that are no strays [m], and the strays.
    """
    ux, uy, uz = 0.0, 0.0, 0.0
    for i in rows:
        ux += velocity[i, 0]
        uy += velocity[i, 1]
        uz += velocity[i, 2]
    share = 1.0 / rows.size if every else 0.0
    ux, uy, uz = ux * share, uy * share, uz * share
    for i in rows:
        dx, dy, dz = velocity[i, 0] - ux, velocity[i, 1] - uy, velocity[i, 2] - uz
        skins[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
    step, steps = ROOM * dt, STEPS
    limit = longest / (step * steps)
    count = _faster(rows, skins, limit)
    while count > most_strays and steps > 1.0:
        steps -= 1.0
        limit = longest / (step * steps)
        count = _faster(rows, skins, limit)
    if count > most_strays:
        limit, count = np.inf, 0
    strays = np.empty(count, np.int64)
    count, fastest = 0, 0.0
    for i in rows:
        if skins[i] > limit:
            strays[count] = i
            count += 1
        else:
            fastest = max(fastest, skins[i])
    steps = min(max(longest / max(step * fastest, 1e-12), 1.0), STEPS)
    for i in rows:
        skins[i] = base + step * steps * skins[i]
    return base + step * steps * fastest, strays


@kernel
def _faster(rows, speed, limit):  # type: ignore[no-untyped-def]
    """How many are."""
    count = 0
    for i in rows:
        count += speed[i] > limit
    return count
