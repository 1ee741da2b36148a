"""Pairs of one particle with those in the cells about it, found sixteen comparisons at a time.

Distances are compared without branches, so that the loop is vectorised. The results are marks of
one byte, and the rows that are marked are appended to the list a vector at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.compaction import COMPACTION_SIZE, append_pairs
from msg_bridge.kernels import helper

__all__ = [
    "REACH",
    "Neighbourhood",
    "allocate_neighbourhood",
    "list_all_pairs",
    "list_later_pairs",
    "mark_neighbours",
]

_X, _Y, _Z, REACH = 0, 1, 2, 3
"""Rows of packed particles: position [m] and search radius [m], float32."""


class Neighbourhood(NamedTuple):
    """Working memory: the particles in the cells about a cell.

    Attributes:
        packed: rows `_X`, `_Y`, `_Z` and `REACH`, float32, shape (4, capacity).
        row: row of each, uint32.
        is_active: whether each is active, uint8.
        mark: whether each is near the particle at hand, uint8.
    """

    packed: NDArray[np.float32]
    row: NDArray[np.uint32]
    is_active: NDArray[np.uint8]
    mark: NDArray[np.uint8]


@helper(allocates=True)
def allocate_neighbourhood(capacity):  # type: ignore[no-untyped-def]
    """Return working memory for a number of particles."""
    capacity += COMPACTION_SIZE
    return Neighbourhood(
        np.empty((4, capacity), np.float32),
        np.empty(capacity, np.uint32),
        np.empty(capacity, np.uint8),
        np.empty(capacity, np.uint8),
    )


@helper(forceinline=True)
def mark_neighbours(packed, is_active, own, size, mark):  # type: ignore[no-untyped-def]
    """Mark the particles within reach of number `own`, if one of the two is active.

    `COMPACTION_SIZE` marks after theirs are cleared. Whole vectors are compared: what the last one
    contains beyond the particles does not matter.
    """
    x, y, z, reach = packed[_X], packed[_Y], packed[_Z], packed[REACH]
    own_x, own_y, own_z, own_reach = x[own], y[own], z[own], reach[own]
    own_active = is_active[own]
    num_compared = (size + COMPACTION_SIZE - 1) // COMPACTION_SIZE * COMPACTION_SIZE
    for m in range(np.uint64(num_compared)):
        dx, dy, dz, near = x[m] - own_x, y[m] - own_y, z[m] - own_z, reach[m] + own_reach
        mark[m] = np.uint8(dx * dx + dy * dy + dz * dz < near * near) & (own_active | is_active[m])
    for m in range(np.uint64(size), np.uint64(size + COMPACTION_SIZE)):
        mark[m] = np.uint8(0)


@helper(forceinline=True)
def list_later_pairs(own, size, around, first, second, count):  # type: ignore[no-untyped-def]
    """List the pairs of number `own` with particles after it.

    Returns:
        Number of pairs in the table.
    """
    row, mark = around.row, around.mark
    mark_neighbours(around.packed, around.is_active, own, size, mark)
    for begin in range(own + 1, size, COMPACTION_SIZE):
        count = append_pairs(row[own], row, mark, begin, first, second, count)
    return count


@helper(forceinline=True)
def list_all_pairs(own, size, num_after, around, first, second, count):  # type: ignore[no-untyped-def]
    """List the pairs of the active number `own` with particles on all sides.

    Each pair is listed once: a pair of two active particles by the first of them in the order of
    cells.

    Returns:
        Number of pairs in the table.
    """
    row, mark, is_active = around.row, around.mark, around.is_active
    mark_neighbours(around.packed, is_active, own, size, mark)
    mark[own] = np.uint8(0)
    _unmark_active(np.uint64(0), np.uint64(own), is_active, mark)
    _unmark_active(np.uint64(num_after), np.uint64(size), is_active, mark)
    for begin in range(0, size, COMPACTION_SIZE):
        count = append_pairs(row[own], row, mark, begin, first, second, count)
    return count


@helper(forceinline=True)
def _unmark_active(low, high, is_active, mark):  # type: ignore[no-untyped-def]
    """Clear the marks of active particles among numbers `low` to `high` - 1."""
    for m in range(low, high):
        mark[m] &= np.uint8(is_active[m] == 0)
