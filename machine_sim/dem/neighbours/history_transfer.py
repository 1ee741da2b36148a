"""Transfer of the contact history from one pair list to the next."""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.dem.compaction import COMPACTION_SIZE, find_value
from machine_sim.dem.partition import NUM_CHUNKS
from msg_bridge.kernels import helper, threaded_kernel

__all__ = ["BOTH_ASLEEP", "transfer_history"]

BOTH_ASLEEP = 2
"""Value of `contact_flag` of a pair in contact that is no longer listed, as both are asleep."""


@threaded_kernel
def transfer_history(old, old_count, old_row, active, new, new_count, begin, end):  # type: ignore[no-untyped-def]
    """Copy the tangential springs of pairs in contact from the old table to the new.

    Args:
        old, old_count: `PairArrays` and number of the old pairs. Pairs that `BOTH_ASLEEP` are
            marked in it, and their rows replaced by the present ones.
        old_row: row of each particle in the old table, -1 for none.
        active: whether each particle moves by forces.
        new, new_count: `PairArrays` and number of the new pairs; contact flags and springs are set.
        begin, end: ranges of the new pairs of each row.

    Returns:
        Number of old pairs marked as both asleep.
    """
    new_row = np.full(old_row.max() + 1, -1, np.int32)
    for i in range(old_row.size):
        if old_row[i] >= 0:
            new_row[old_row[i]] = i
    contact_flag = new.contact_flag
    for c in prange(NUM_CHUNKS):
        contact_flag[c * new_count // NUM_CHUNKS : (c + 1) * new_count // NUM_CHUNKS] = 0
    num_asleep = np.zeros(NUM_CHUNKS, np.int64)
    for c in prange(NUM_CHUNKS):
        num_asleep[c] = _transfer_chunk(
            c * old_count // NUM_CHUNKS, (c + 1) * old_count // NUM_CHUNKS, old, new_row, active,
            new, begin, end,
        )  # fmt: skip
    return num_asleep.sum()


@helper(allocates=True, forceinline=True)
def _transfer_chunk(low, high, old, new_row, active, new, begin, end):  # type: ignore[no-untyped-def]
    """Transfer the history of a range of the old pairs.

    Args:
        low, high: first pair of the range and its end, which is excluded.
        old, active, new, begin, end: see `transfer_history`.
        new_row: present row of each old row, -1 for none; rows beyond its end were removed.

    Returns:
        Number of pairs marked as both asleep.
    """
    first, second, contact_flag, spring = old.first, old.second, old.contact_flag, old.spring
    new_second, new_flag, new_spring = new.second, new.contact_flag, new.spring
    # Pairs in contact are selected without branches, which no processor could predict.
    touching, count = np.empty(high - low, np.uint64), np.uint64(0)
    for m in range(np.uint64(low), np.uint64(high)):
        touching[count] = m
        count += np.uint64(contact_flag[m] != 0)
    num_asleep = 0
    for m in touching[:count]:
        i = new_row[first[m]] if first[m] < new_row.size else -1
        j = new_row[second[m]] if second[m] < new_row.size else -1
        if i < 0 or j < 0:
            continue
        if not (active[i] or active[j]):
            contact_flag[m] = BOTH_ASLEEP
            first[m], second[m] = i, j
            num_asleep += 1
            continue
        # Which of the two is the first is as good as random: both are searched, without a branch.
        k = _find_row(new_second, begin[i], end[i], j)
        k_swapped = _find_row(new_second, begin[j], end[j], i)
        # The spring points from the first particle to the second.
        sign = np.float32(1.0 if k >= 0 else -1.0)
        k = max(k, k_swapped)
        if k >= 0:
            new_flag[k] = 1
            for axis in range(3):
                new_spring[k, axis] = sign * spring[m, axis]
    return num_asleep


@helper(forceinline=True)
def _find_row(rows, low, high, row):  # type: ignore[no-untyped-def]
    """Return the index of `row` in rows[low:high], -1 if it is not there."""
    for begin in range(low, high, COMPACTION_SIZE):
        n = find_value(rows, begin, min(high - begin, COMPACTION_SIZE), np.uint32(row))
        if n < COMPACTION_SIZE:
            return begin + n
    return -1
