"""Partition of the work of a step, so that several threads can do parts of it at the same time.

The pair list is in the order of slabs of cells, and the particles of a pair lie in its slab or the
next one (or the previous one, where only few particles are active). So it is cut into *regions*,
runs of slabs, separated by *region boundaries*, one or two slabs each: no two regions contain the
same particle, and no two region boundaries do. Forces are added up in all regions at once, then in
all region boundaries at once.

The cuts depend on the list alone. So the order in which forces are added up, and with it every bit
of the result, is the same for any number of threads.

Work on single particles is divided into *chunks* of their rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel

__all__ = ["NUM_CHUNKS", "aligned_bounds", "interleave", "partition_pairs", "row_chunk"]

NUM_CHUNKS = 8
"""Number of chunks that rows are divided into."""
_MAX_REGIONS = 8
"""Maximum number of regions, and so of threads that work at the same time."""
_MIN_PAIRS_PER_REGION = 8192
"""Minimum number of pairs in a region; with fewer, threads cost more than they save."""


def partition_pairs(slabs: NDArray[np.int64], slabs_per_boundary: int) -> list[int]:
    """Cut a pair list into regions with about the same number of pairs.

    Args:
        slabs: first pair of each slab, and the end, ascending, shape (slabs + 1,).
        slabs_per_boundary: number of slabs in a region boundary: 1 where a pair reaches into the
            next slab, 2 where it reaches into both adjacent slabs.

    Returns:
        Bounds, 2 for each region: region r has the pairs bounds[2r] to bounds[2r + 1], and the
        region boundary after it the pairs from there to bounds[2r + 2].
    """
    count = int(slabs[-1])
    num_regions = min(_MAX_REGIONS, count // _MIN_PAIRS_PER_REGION)
    bounds, min_cut = [0], slabs_per_boundary
    for r in range(1, num_regions):
        cut = max(int(np.searchsorted(slabs, r * count / num_regions)), min_cut)
        if cut + 2 * slabs_per_boundary > len(slabs) - 1:
            break
        bounds += [int(slabs[cut]), int(slabs[cut + slabs_per_boundary])]
        min_cut = cut + 2 * slabs_per_boundary
    return [*bounds, count]


@helper(allocates=True, forceinline=True)
def row_chunk(rows, c):  # type: ignore[no-untyped-def]
    """Return chunk number `c` of some rows."""
    return rows[c * rows.size // NUM_CHUNKS : (c + 1) * rows.size // NUM_CHUNKS]


@helper(forceinline=True)
def aligned_bounds(count, c, size):  # type: ignore[no-untyped-def]
    """Return begin and end of chunk number `c` of `count` items, in whole blocks of `size`."""
    num_blocks = (count + size - 1) // size
    begin, end = c * num_blocks // NUM_CHUNKS, (c + 1) * num_blocks // NUM_CHUNKS
    return min(begin * size, count), min(end * size, count)


@kernel(forceinline=True)
def interleave(r, count):  # type: ignore[no-untyped-def]
    """Return the part, of `count`, that iteration `r` of a parallel loop works on.

    Parts with even numbers come first, then those with odd numbers. A thread takes consecutive
    iterations, and adjacent parts are of similar size: so they go to different threads.
    """
    num_even = (count + 1) // 2
    return 2 * r if r < num_even else 2 * (r - num_even) + 1
