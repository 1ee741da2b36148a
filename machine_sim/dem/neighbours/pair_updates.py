"""A pair list that stays good while a few particles come and go, without being made anew.

Where soil is cut and lands some come and go in every tick. Pairs of those that go are taken out.
Those that come are compared with all others, at the places where these were when they were listed:
a list holds as long as nobody has left the common motion *since then* by more than its skin, and
that must hold for pairs of new and old, too.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.kernels import kernel

__all__ = ["insert_rows", "mean_displacement", "remove_pairs"]


@kernel
def remove_pairs(kept, num_listed, first, second, contact_flag, spring, num_pairs):  # type: ignore[no-untyped-def]
    """Take out the pairs of rows that are gone, and number the others anew.

    Args:
        kept: rows that are left, ascending, in old numbers.
        listed: how many rows there were.
        first, second, touching, spring: of the pair table; updated.
        pairs: how many.

    Returns:
        How many are left.
    """
    new_row = np.full(num_listed, -1, np.int64)
    for k in range(kept.size):
        new_row[kept[k]] = k
    count = 0
    for k in range(num_pairs):
        i, j = new_row[first[k]], new_row[second[k]]
        if i < 0 or j < 0:
            continue
        first[count], second[count], contact_flag[count] = i, j, contact_flag[k]
        for axis in range(3):
            spring[count, axis] = spring[k, axis]
        count += 1
    return count


@kernel
def mean_displacement(rows, position, origin):  # type: ignore[no-untyped-def]
    """Mean way [m] of some rows since they were listed, shape (3,)."""
    displacement = np.zeros(3)
    for i in rows:
        for axis in range(3):
            displacement[axis] += position[i, axis] - origin[i, axis]
    return displacement / rows.size


@kernel
def insert_rows(  # type: ignore[no-untyped-def]
    num_listed,
    active,
    origin,
    predicted_radii,
    skin_widths,
    first,
    second,
    contact_flag,
    spring,
    num_pairs,
):
    """List the pairs of the rows from `listed` on behind the others.

    Args:
        listed: rows that are in the table already.
        live: which rows move by forces; two that do not are no pair.
        origin: where all were when they were listed [m]; for new ones where they would have been.
        sizes, skins: of all [m].
        first, second, touching, spring: of the pair table; updated.
        pairs: how many there are.

    Returns:
        How many there are now, or -1 where the table is too small.
    """
    near = np.empty(active.size, np.bool_)
    for i in range(num_listed, active.size):
        x, y, z = origin[i, 0], origin[i, 1], origin[i, 2]
        size = predicted_radii[i] + skin_widths[i]
        for j in range(np.uint64(i)):
            dx, dy, dz = origin[j, 0] - x, origin[j, 1] - y, origin[j, 2] - z
            reach = size + predicted_radii[j] + skin_widths[j]
            near[j] = dx * dx + dy * dy + dz * dz < reach * reach
        if num_pairs + i > first.size:
            return -1
        for j in range(i):
            if near[j] and (active[i] or active[j]):
                first[num_pairs], second[num_pairs], contact_flag[num_pairs] = i, j, 0
                for axis in range(3):
                    spring[num_pairs, axis] = 0.0
                num_pairs += 1
    return num_pairs
