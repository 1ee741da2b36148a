"""Insertion and removal of particles in a pair list, without a rebuild.

Where soil is excavated and deposited, particles are added and removed in every tick. The pairs of
removed particles are deleted. An added particle is compared with all others at the positions where
these were listed: a list is valid as long as no particle has left the common motion *since it was
listed* by more than its skin, and that must hold for pairs of an added particle and an older one,
too.
"""

from __future__ import annotations

import numpy as np

from machine_sim.dem.vec3 import dot, load_row, subtract
from msg_bridge.kernels import fixed_signature_kernel, kernel

__all__ = ["insert_rows", "keep_listed", "mean_displacement", "remove_pairs"]


@fixed_signature_kernel
def remove_pairs(kept, num_listed, pairs, num_pairs):  # type: ignore[no-untyped-def]
    """Delete the pairs of removed rows, and renumber the rows of the others.

    Args:
        kept: previous numbers of the rows that are left, ascending.
        num_listed: previous number of rows.
        pairs: `PairArrays`; updated.
        num_pairs: previous number of pairs.

    Returns:
        Number of pairs.
    """
    new_row = np.full(num_listed, -1, np.int64)
    for k in range(kept.size):
        new_row[kept[k]] = k
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
def keep_listed(kept, active, listed, kept_active, kept_listed):  # type: ignore[no-untyped-def]
    """Copy which rows are active, and `ListedParticles`, of the rows `kept` only."""
    for k in range(kept.size):
        i = kept[k]
        kept_active[k] = active[i]
        for axis in range(3):
            kept_listed.position[k, axis] = listed.position[i, axis]
        kept_listed.skin_width[k] = listed.skin_width[i]
        kept_listed.predicted_radius[k] = listed.predicted_radius[i]


@kernel
def mean_displacement(rows, position, listed_position):  # type: ignore[no-untyped-def]
    """Return the mean displacement [m] of some rows since they were listed, shape (3,)."""
    displacement = np.zeros(3)
    for i in rows:
        for axis in range(3):
            displacement[axis] += position[i, axis] - listed_position[i, axis]
    return displacement / rows.size


@kernel
def insert_rows(num_listed, particles, pairs, num_pairs):  # type: ignore[no-untyped-def]
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
