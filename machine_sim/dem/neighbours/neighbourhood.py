"""Pairs of one particle with those in the cells about it, found eight comparisons at a time.

Few particles of a neighbourhood are near. Distances are compared without branches, so that the loop
is vectorised, and the results are marks of one byte; words of eight marks without any are skipped.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper

__all__ = [
    "REACH",
    "WORD",
    "Neighbourhood",
    "allocate_neighbourhood",
    "list_all_pairs",
    "list_later_pairs",
    "mark_neighbours",
]

_X, _Y, _Z, REACH = 0, 1, 2, 3
"""Rows of packed particles: position [m] and search radius [m], float32."""
WORD = 8
"""Marks that are tested together, as one 64-bit word."""


class Neighbourhood(NamedTuple):
    """Working memory: the particles in the cells about a cell.

    Attributes:
        packed: rows `_X`, `_Y`, `_Z` and `REACH`, float32, shape (4, capacity).
        row: row of each, uint32.
        is_active: whether each is active, uint8.
        mark: whether each is near the particle at hand, uint8, shape (capacity + `WORD`,).
        marked_words: words of `mark` that are not zero.
    """

    packed: NDArray[np.float32]
    row: NDArray[np.uint32]
    is_active: NDArray[np.uint8]
    mark: NDArray[np.uint8]
    marked_words: NDArray[np.int64]


@helper(allocates=True)
def allocate_neighbourhood(capacity):  # type: ignore[no-untyped-def]
    """Return working memory for a number of particles."""
    return Neighbourhood(
        np.empty((4, capacity), np.float32),
        np.empty(capacity, np.uint32),
        np.empty(capacity, np.uint8),
        np.zeros(capacity + WORD, np.uint8),
        np.empty(capacity // WORD + 1, np.int64),
    )


@helper(forceinline=True)
def mark_neighbours(packed, is_active, own, size, mark):  # type: ignore[no-untyped-def]
    """Mark the particles within reach of number `own`, if one of the two is active.

    Marks are written up to a multiple of `WORD`.
    """
    x, y, z, reach = packed[_X], packed[_Y], packed[_Z], packed[REACH]
    own_x, own_y, own_z, own_reach = x[own], y[own], z[own], reach[own]
    own_active = is_active[own]
    for m in range(np.uint64(size)):
        dx, dy, dz, near = x[m] - own_x, y[m] - own_y, z[m] - own_z, reach[m] + own_reach
        mark[m] = np.uint8(dx * dx + dy * dy + dz * dz < near * near) & (own_active | is_active[m])
    for m in range(size, (size + WORD - 1) // WORD * WORD):
        mark[m] = np.uint8(0)


@helper(forceinline=True)
def _find_marked_words(low, size, mark, marked_words):  # type: ignore[no-untyped-def]
    """Find the words of marks from `low` on that are not zero; few are. Return their number."""
    words = mark[: mark.size // WORD * WORD].view(np.uint64)
    count = 0
    for word in range(low, (size + WORD - 1) // WORD):
        marked_words[count] = word
        count += words[word] != 0
    return count


@helper(forceinline=True)
def list_later_pairs(own, size, around, first, second, count):  # type: ignore[no-untyped-def]
    """List the pairs of number `own` with particles after it, without branches.

    Returns:
        Number of pairs in the table.
    """
    row, mark, marked_words = around.row, around.mark, around.marked_words
    mark_neighbours(around.packed, around.is_active, own, size, mark)
    for n in range(_find_marked_words(own // WORD, size, mark, marked_words)):
        low = WORD * marked_words[n]
        for m in range(max(low, own + 1), low + WORD):
            first[count] = row[own]
            second[count] = row[min(m, size - 1)]
            count += np.int64(mark[m])
    return count


@helper(forceinline=True)
def list_all_pairs(own, size, num_after, around, first, second, count):  # type: ignore[no-untyped-def]
    """List the pairs of the active number `own` with particles on all sides.

    Each pair is listed once: a pair of two active particles by the first of them in the order of
    cells.

    Returns:
        Number of pairs in the table.
    """
    row, mark, marked_words = around.row, around.mark, around.marked_words
    is_active = around.is_active
    mark_neighbours(around.packed, is_active, own, size, mark)
    for n in range(_find_marked_words(0, size, mark, marked_words)):
        low = WORD * marked_words[n]
        for m in range(low, min(low + WORD, size)):
            is_before = m < own or m >= num_after
            if mark[m] == 0 or m == own or (is_active[m] and is_before):
                continue
            first[count] = row[own]
            second[count] = row[m]
            count += 1
    return count
