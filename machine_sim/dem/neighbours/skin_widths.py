"""Skin widths and predicted radii: how far ahead a pair list searches, and when it expires."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange
from numba.extending import register_jitable
from numpy.typing import NDArray

from machine_sim.dem.partition import NUM_CHUNKS, row_chunk
from machine_sim.dem.vec3 import add, dot, load_row, scale, subtract
from msg_bridge.kernels import helper, kernel, threaded_helper

__all__ = [
    "ACCELERATION_MARGIN",
    "LIST_LIFETIME_STEPS",
    "GrowthPrediction",
    "ListedParticles",
    "any_skin_exceeded",
    "compute_skin_widths",
    "predict_contact_radii",
    "tracks_all_rows",
]

LIST_LIFETIME_STEPS = 5.0
"""Number of steps that a list should be valid for while particles move."""
ACCELERATION_MARGIN = 1.3
"""Skin width over the distance travelled at constant velocity: a margin for acceleration."""
_TRACK_ALL_FRACTION = 0.75
"""Fraction of moving particles above which a list tracks the motion of all."""


class ListedParticles(NamedTuple):
    """What a pair list assumed of its particles when it was made, by row.

    Attributes:
        position: centres at that time [m], shape (n, 3).
        skin_width: displacement relative to the mean that the list allows for [m], shape (n,).
        predicted_radius: contact radius that the list allows for [m], shape (n,).
    """

    position: NDArray[np.float64]
    skin_width: NDArray[np.float64]
    predicted_radius: NDArray[np.float64]

    @classmethod
    def empty(cls, count: int) -> ListedParticles:
        """Return arrays to be filled for a number of particles."""
        return cls(np.empty((count, 3)), np.empty(count), np.empty(count))


class GrowthPrediction(NamedTuple):
    """Bounds of the growth of contact radii.

    Attributes:
        initial: maximum contact radius of a particle just released, in radii.
        increase: maximum growth in the time looked ahead, in radii.
    """

    initial: float
    increase: float


@register_jitable
def tracks_all_rows(num_moving: int, count: int) -> bool:
    """Return whether a list tracks all particles where a number of them, of `count`, move.

    A list measures displacements from the mean of the tracked rows. Where most particles rest, only
    the moving ones are tracked.
    """
    return num_moving > _TRACK_ALL_FRACTION * count


@threaded_helper
def any_skin_exceeded(rows, tracks_all, particles, listed, growth, dt):  # type: ignore[no-untyped-def]
    """Return whether a particle may leave its skin or outgrow its predicted radius within a step.

    Args:
        rows: tracked rows.
        tracks_all: whether these are all particles: then displacements are relative to their mean.
        particles: `ParticleColumns`.
        listed: `ListedParticles`.
        growth: `GrowthPrediction` of one step.
        dt: length of the step [s].
    """
    position, velocity = particles.position, particles.velocity
    contact_radius, radius = particles.contact_radius, particles.radius
    displacement = np.zeros((NUM_CHUNKS, 3))
    if tracks_all:
        for c in prange(NUM_CHUNKS):
            _sum_displacements(
                row_chunk(rows, c), position, velocity, listed.position, dt, displacement[c]
            )
    mean = np.zeros(3)
    for c in range(NUM_CHUNKS):
        for axis in range(3):
            mean[axis] += displacement[c, axis] / rows.size
    exceeded = np.zeros(NUM_CHUNKS, np.bool_)
    for c in prange(NUM_CHUNKS):
        chunk = row_chunk(rows, c)
        exceeded[c] = _exceeds_skin(
            chunk, position, velocity, listed, dt, mean
        ) or _exceeds_predicted_radius(chunk, contact_radius, radius, listed, growth)
    return exceeded.any()


@helper(forceinline=True)
def _sum_displacements(rows, position, velocity, listed_position, dt, displacement):  # type: ignore[no-untyped-def]
    """Add up the displacements of some rows at the end of the step [m]."""
    for k in range(rows.size):
        i = np.uint64(rows[k])
        for axis in range(3):
            displacement[axis] += (
                position[i, axis] - listed_position[i, axis] + dt * velocity[i, axis]
            )


@helper(forceinline=True)
def _exceeds_skin(rows, position, velocity, listed, dt, mean):  # type: ignore[no-untyped-def]
    """Return whether the displacement of a row at the end of the step exceeds its skin width."""
    listed_position, skin_width = listed.position, listed.skin_width
    for k in range(rows.size):
        i = np.uint64(rows[k])
        displacement = subtract(load_row(position, i, 0), load_row(listed_position, i, 0))
        displacement = add(displacement, scale(load_row(velocity, i, 0), dt))
        relative = subtract(displacement, mean)
        if dot(relative, relative) > skin_width[i] * skin_width[i]:
            return True
    return False


@helper(forceinline=True)
def _exceeds_predicted_radius(rows, contact_radius, radius, listed, growth):  # type: ignore[no-untyped-def]
    """Return whether the contact radius of a row may exceed the predicted one."""
    predicted_radius, exceeds = listed.predicted_radius, False
    for k in range(rows.size):
        i = np.uint64(rows[k])
        grown = _grown_radius(contact_radius[i], radius[i], growth)
        exceeds |= grown > predicted_radius[i]
    return exceeds


@kernel
def predict_contact_radii(contact_radius, radius, growth, predicted_radius):  # type: ignore[no-untyped-def]
    """Fill `predicted_radius` [m] with the contact radii after growth by `GrowthPrediction`."""
    for i in range(predicted_radius.size):
        predicted_radius[i] = _grown_radius(contact_radius[i], radius[i], growth)


@helper(forceinline=True)
def _grown_radius(contact_radius, radius, growth):  # type: ignore[no-untyped-def]
    """Return the maximum contact radius [m] after growth; it is 0 before the first step."""
    present = contact_radius if contact_radius > 0.0 else growth.initial * radius
    return min(present + growth.increase * radius, np.float64(radius))


@helper(allocates=True)
def compute_skin_widths(  # type: ignore[no-untyped-def]
    rows, tracks_all, velocity, dt, base_width, max_width, max_fast_outliers, skin_width
):
    """Compute the skin widths of `rows`: a base and the distance travelled in some steps.

    Distances are relative to the mean motion if all particles are tracked. The number of steps is
    `LIST_LIFETIME_STEPS`, or fewer where more than `max_fast_outliers` particles would travel
    farther than `max_width`, but at least one.

    Args:
        rows: tracked rows.
        tracks_all: whether these are all particles.
        velocity: [m/s], shape (n, 3).
        dt: length of a step [s].
        base_width: skin width of a particle at rest [m].
        max_width: maximum distance travelled, but for fast outliers [m].
        max_fast_outliers: maximum number of fast outliers.
        skin_width: out, by row [m], shape (n,).

    Returns:
        Largest skin width without fast outliers [m], and the rows of these.
    """
    mean = _mean_velocity(rows, velocity) if tracks_all else (0.0, 0.0, 0.0)
    speed = skin_width
    for i in rows:
        relative = subtract(load_row(velocity, i, 0), mean)
        speed[i] = np.sqrt(dot(relative, relative))
    step, num_steps = ACCELERATION_MARGIN * dt, LIST_LIFETIME_STEPS
    max_speed = max_width / (step * num_steps)
    count = _count_faster(rows, speed, max_speed)
    while count > max_fast_outliers and num_steps > 1.0:
        num_steps -= 1.0
        max_speed = max_width / (step * num_steps)
        count = _count_faster(rows, speed, max_speed)
    if count > max_fast_outliers:
        max_speed, count = np.inf, 0
    fast_outliers = np.empty(count, np.int64)
    count, fastest = 0, 0.0
    for i in rows:
        if speed[i] > max_speed:
            fast_outliers[count] = i
            count += 1
        else:
            fastest = max(fastest, speed[i])
    num_steps = min(max(max_width / max(step * fastest, 1e-12), 1.0), LIST_LIFETIME_STEPS)
    for i in rows:
        skin_width[i] = base_width + step * num_steps * speed[i]
    return base_width + step * num_steps * fastest, fast_outliers


@helper(forceinline=True)
def _mean_velocity(rows, velocity):  # type: ignore[no-untyped-def]
    """Return the mean velocity of some rows [m/s]."""
    total = 0.0, 0.0, 0.0
    for i in rows:
        total = add(total, load_row(velocity, i, 0))
    return scale(total, 1.0 / rows.size)


@helper(forceinline=True)
def _count_faster(rows, speed, max_speed):  # type: ignore[no-untyped-def]
    """Return the number of rows faster than `max_speed` [m/s]."""
    count = 0
    for i in rows:
        count += speed[i] > max_speed
    return count
