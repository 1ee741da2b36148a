"""Insertion and removal of particles in a pair list, without a rebuild.

Where soil is excavated and deposited, particles are added and removed in every tick. The pairs of
removed particles are deleted. An added particle is compared with all others at the positions where
these were listed: a list is valid as long as no particle has left the common motion *since it was
listed* by more than its skin, and that must hold for pairs of an added particle and an older one,
too.
"""

from __future__ import annotations

import numpy as np

from machine_sim.dem.neighbours.pair_search import SearchParticles, mark_active
from machine_sim.dem.neighbours.skin_widths import (
    ACCELERATION_MARGIN,
    LIST_LIFETIME_STEPS,
    predict_contact_radii,
)
from machine_sim.dem.vec3 import dot, load_row, subtract
from msg_bridge.kernels import fixed_signature_kernel, helper

__all__ = ["insert_rows", "remove_rows"]


@fixed_signature_kernel
def remove_rows(kept, boxed_list, num_pairs, listed, active, boxed_particles):  # type: ignore[no-untyped-def]
    """Delete the pairs of removed rows, and renumber the rows of the others.

    Args:
        kept: previous numbers of the rows that are left, ascending, those that are not listed
            included.
        boxed_list: `ListedPairs`, boxed; updated.
        num_pairs: previous number of pairs.
        listed, active: `ListedParticles`, and whether each is active; updated.
        boxed_particles: `ParticleColumns` of the rows that are left, boxed; their rows in the list
            are updated.

    Returns:
        (number of pairs, number of listed rows).
    """
    pairs, list_row = boxed_list.table.arrays, boxed_particles.table.pair_list_row
    new_row, num_kept = np.full(active.size, -1, np.int64), np.int64(0)
    for k in range(kept.size):
        i = kept[k]
        if i >= active.size:
            break
        new_row[i], list_row[k] = k, k
        active[k] = active[i]
        for axis in range(3):
            listed.position[k, axis] = listed.position[i, axis]
        listed.skin_width[k] = listed.skin_width[i]
        listed.predicted_radius[k] = listed.predicted_radius[i]
        num_kept += 1
    return _remove_pairs(new_row, pairs, num_pairs), num_kept


@helper
def _remove_pairs(new_row, pairs, num_pairs):  # type: ignore[no-untyped-def]
    """Keep the pairs of rows that have a new number; return how many they are."""
    count = 0
    for k in range(num_pairs):
        i, j = new_row[pairs.first[k]], new_row[pairs.second[k]]
        if i < 0 or j < 0:
            continue
        pairs.first[count], pairs.second[count] = i, j
        pairs.contact_flag[count] = pairs.contact_flag[k]
        for axis in range(3):
            pairs.spring[count, axis] = pairs.spring[k, axis]
        count += 1
    return count


@fixed_signature_kernel
def insert_rows(  # type: ignore[no-untyped-def]
    dt, base_width, growth, tracked_rows, boxed_particles, boxed_list, num_pairs, old, old_active,
    listed, active,
):  # fmt: skip
    """List the rows that are not listed yet, and append their pairs.

    Args:
        dt: length of the next steps [s].
        base_width: skin width of a particle at rest [m].
        growth: `GrowthPrediction` of the lifetime of a list.
        tracked_rows: rows whose motion counts: all particles, or those that move.
        boxed_particles: `ParticleColumns`, boxed; the rows in the list of added ones are set.
        boxed_list: `ListedPairs`, boxed; updated.
        num_pairs: number of pairs in it.
        old, old_active: `ListedParticles` of the rows listed already, and whether each is active.
        listed, active: out, the same of all rows.

    Returns:
        Number of pairs, or -1 where the table is too small.
    """
    particles, num_listed = boxed_particles.table, old_active.size
    position, velocity, reach = listed.position, particles.velocity, np.empty(active.size)
    predict_contact_radii(
        particles.contact_radius, particles.radius, growth, listed.predicted_radius
    )
    mark_active(particles, active)
    for i in range(num_listed):
        listed.skin_width[i] = old.skin_width[i]
        listed.predicted_radius[i] = old.predicted_radius[i]
        for axis in range(3):
            position[i, axis] = old.position[i, axis]
    displacement, mean_velocity = _mean_motion(tracked_rows, particles, old.position, active.size)
    travel_time = ACCELERATION_MARGIN * dt * LIST_LIFETIME_STEPS
    for i in range(num_listed, active.size):
        relative = subtract(load_row(velocity, i, 0), mean_velocity)
        listed.skin_width[i] = base_width + travel_time * np.sqrt(dot(relative, relative))
        for axis in range(3):
            position[i, axis] = particles.position[i, axis] - displacement[axis]
    for i in range(active.size):
        reach[i] = listed.predicted_radius[i] + listed.skin_width[i]
    num_pairs = _append_pairs(
        num_listed, SearchParticles(position, reach, active), boxed_list.table.arrays, num_pairs
    )
    if num_pairs >= 0:
        for i in range(num_listed, active.size):
            particles.pair_list_row[i] = i
    for i in range(num_listed):
        active[i] = old_active[i]
    return num_pairs


@helper
def _mean_motion(rows, particles, listed_position, count):  # type: ignore[no-untyped-def]
    """Return the mean displacement since they were listed [m], and the mean velocity [m/s].

    Both are zero where not all particles, of `count`, are tracked: then skins are not relative to
    them.

    Args:
        rows: tracked rows; those that are not listed do not count.
        particles: `ParticleColumns`.
        listed_position: positions at which the listed rows were listed [m].
        count: number of particles.
    """
    dx, dy, dz = 0.0, 0.0, 0.0
    vx, vy, vz = 0.0, 0.0, 0.0
    num_rows = 0
    if rows.size == count:
        for i in rows:
            if i >= listed_position.shape[0]:
                continue
            moved = subtract(load_row(particles.position, i, 0), load_row(listed_position, i, 0))
            velocity = load_row(particles.velocity, i, 0)
            dx, dy, dz = dx + moved[0], dy + moved[1], dz + moved[2]
            vx, vy, vz = vx + velocity[0], vy + velocity[1], vz + velocity[2]
            num_rows += 1
    n = max(num_rows, 1)
    return (dx / n, dy / n, dz / n), (vx / n, vy / n, vz / n)


@helper(allocates=True)
def _append_pairs(num_listed, particles, pairs, num_pairs):  # type: ignore[no-untyped-def]
    """Append the pairs of the rows from `num_listed` on.

    Args:
        num_listed: number of rows in the table already.
        particles: `SearchParticles` with the positions at which they were listed; for an added
            particle that at which it would have been.
        pairs: `PairArrays`; updated.
        num_pairs: number of pairs in the table already.

    Returns:
        Number of pairs, or -1 where the table is too small.
    """
    position, reach, active = particles.position, particles.reach, particles.active
    is_near = np.empty(active.size, np.bool_)
    for i in range(num_listed, active.size):
        centre, own_reach = load_row(position, i, 0), reach[i]
        for j in range(np.uint64(i)):
            separation = subtract(load_row(position, j, 0), centre)
            max_distance = own_reach + reach[j]
            is_near[j] = dot(separation, separation) < max_distance * max_distance
        if num_pairs + i > pairs.first.size:
            return -1
        for j in range(i):
            if is_near[j] and (active[i] or active[j]):
                pairs.first[num_pairs], pairs.second[num_pairs] = i, j
                pairs.contact_flag[num_pairs] = 0
                for axis in range(3):
                    pairs.spring[num_pairs, axis] = 0.0
                num_pairs += 1
    return num_pairs
