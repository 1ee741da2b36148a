"""Skins and sizes: how far a pair list looks ahead of each particle, and when that is used up."""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.dem.partition import NUM_CHUNKS, row_chunk
from msg_bridge.kernels import kernel, threaded_kernel

__all__ = [
    "ACCELERATION_MARGIN",
    "LIST_LIFETIME_STEPS",
    "any_skin_exceeded",
    "compute_skin_widths",
    "predict_contact_radii",
]

LIST_LIFETIME_STEPS = 5.0
"""For how many steps a list should hold where particles move."""
ACCELERATION_MARGIN = 1.3
"""Room for acceleration: how far ahead a particle is looked for, over how far it comes."""


@threaded_kernel
def any_skin_exceeded(  # type: ignore[no-untyped-def]
    rows,
    tracks_all,
    position,
    velocity,
    origin,
    skin_widths,
    contact_radius,
    radius,
    predicted_radii,
    start,
    growth,
    dt,
):
    """Whether one of `rows` may leave its skin or outgrow its size within the next step.

    Seen from the mean motion where they are all there are.
    """
    displacement = np.zeros((NUM_CHUNKS, 3))
    if tracks_all:
        for c in prange(NUM_CHUNKS):
            _sum_displacements(row_chunk(rows, c), position, velocity, origin, dt, displacement[c])
    mean = np.zeros(3)
    for c in range(NUM_CHUNKS):
        for axis in range(3):
            mean[axis] += displacement[c, axis] / rows.size
    exceeded = np.zeros(NUM_CHUNKS, np.bool_)
    for c in prange(NUM_CHUNKS):
        part = row_chunk(rows, c)
        exceeded[c] = _exceeds_skin(
            part, position, velocity, origin, skin_widths, dt, mean
        ) or _exceeds_predicted_radius(part, contact_radius, radius, predicted_radii, start, growth)
    return exceeded.any()


@kernel
def _sum_displacements(rows, position, velocity, origin, dt, displacement):  # type: ignore[no-untyped-def]
    for i in rows:
        for axis in range(3):
            displacement[axis] += position[i, axis] - origin[i, axis] + dt * velocity[i, axis]


@kernel
def _exceeds_skin(rows, position, velocity, origin, skin_widths, dt, mean):  # type: ignore[no-untyped-def]
    for i in rows:
        dx = position[i, 0] - origin[i, 0] + dt * velocity[i, 0] - mean[0]
        dy = position[i, 1] - origin[i, 1] + dt * velocity[i, 1] - mean[1]
        dz = position[i, 2] - origin[i, 2] + dt * velocity[i, 2] - mean[2]
        if dx * dx + dy * dy + dz * dz > skin_widths[i] * skin_widths[i]:
            return True
    return False


@kernel
def _exceeds_predicted_radius(rows, contact_radius, radius, predicted_radii, start, growth):  # type: ignore[no-untyped-def]
    found = False
    for i in rows:
        found |= _grown_radius(contact_radius[i], radius[i], start, growth) > predicted_radii[i]
    return found


@kernel
def predict_contact_radii(contact_radius, radius, start, growth, predicted_radii):  # type: ignore[no-untyped-def]
    """Fill `sizes` with what contact radii grow to [m]."""
    for i in range(predicted_radii.size):
        predicted_radii[i] = _grown_radius(contact_radius[i], radius[i], start, growth)


@kernel(forceinline=True)
def _grown_radius(contact_radius, radius, start, growth):  # type: ignore[no-untyped-def]
    """Contact radius after growing by `growth` radii; one just released starts at up to `start`."""
    least = contact_radius if contact_radius > 0.0 else start * radius
    return min(least + growth * radius, np.float64(radius))


@kernel
def compute_skin_widths(  # type: ignore[no-untyped-def]
    rows, tracks_all, velocity, dt, base, max_skin_width, max_fast_outliers, skin_widths
):
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
    share = 1.0 / rows.size if tracks_all else 0.0
    ux, uy, uz = ux * share, uy * share, uz * share
    for i in rows:
        dx, dy, dz = velocity[i, 0] - ux, velocity[i, 1] - uy, velocity[i, 2] - uz
        skin_widths[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
    step, steps = ACCELERATION_MARGIN * dt, LIST_LIFETIME_STEPS
    limit = max_skin_width / (step * steps)
    count = _count_faster(rows, skin_widths, limit)
    while count > max_fast_outliers and steps > 1.0:
        steps -= 1.0
        limit = max_skin_width / (step * steps)
        count = _count_faster(rows, skin_widths, limit)
    if count > max_fast_outliers:
        limit, count = np.inf, 0
    fast_outliers = np.empty(count, np.int64)
    count, fastest = 0, 0.0
    for i in rows:
        if skin_widths[i] > limit:
            fast_outliers[count] = i
            count += 1
        else:
            fastest = max(fastest, skin_widths[i])
    steps = min(max(max_skin_width / max(step * fastest, 1e-12), 1.0), LIST_LIFETIME_STEPS)
    for i in rows:
        skin_widths[i] = base + step * steps * skin_widths[i]
    return base + step * steps * fastest, fast_outliers


@kernel
def _count_faster(rows, speed, limit):  # type: ignore[no-untyped-def]
    """How many are."""
    count = 0
    for i in rows:
        count += speed[i] > limit
    return count
