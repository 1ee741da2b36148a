"""Parts of the pair list at which several threads can work at once.

The list is in order of slabs of cells, and a pair's particles lie in its slab or the next one (or
the one before, where only few particles are live). So it falls into *regions*, runs of slabs,
parted by *seams*, a slab or two each: no two regions touch the same particle, and no two seams do.
Forces are added up in all regions at once, then in all seams.

Where it is cut depends on the list alone. So the order in which forces add up, and with it every
bit of the result, is the same on any number of threads.

Work on single particles is shared out by *chunks* of their rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import kernel

__all__ = ["NUM_CHUNKS", "interleave", "partition_pairs", "row_chunk"]

NUM_CHUNKS = 8
"""Chunks that rows are cut into."""
_MAX_REGIONS = 8
"""Most regions: as many threads have something to do."""
_MIN_PAIRS_PER_REGION = 8192
"""Least pairs of a region, else threads cost more than they save."""


def partition_pairs(slabs: NDArray[np.int64], boundary_slabs: int) -> NDArray[np.int64]:
    """Cut a pair list into regions of about the same number of pairs.

    Args:
        slabs: first pair of each slab, and the end, shape (slabs + 1,), ascending.
        seam: slabs in a seam: 1 where a pair reaches into the next slab, 2 where into both.

    Returns:
        Bounds, shape (2 * regions,): region r has pairs bounds[2r] to bounds[2r + 1], and the seam
        behind it those from there to bounds[2r + 2].
    """
    count = int(slabs[-1])
    regions = min(_MAX_REGIONS, count // _MIN_PAIRS_PER_REGION)
    bounds, free = [0], boundary_slabs
    for r in range(1, regions):
        at = max(int(np.searchsorted(slabs, r * count / regions)), free)
        if at + 2 * boundary_slabs > len(slabs) - 1:
            break
        bounds += [int(slabs[at]), int(slabs[at + boundary_slabs])]
        free = at + 2 * boundary_slabs
    return np.array([*bounds, count], dtype=np.int64)


@kernel(forceinline=True)
def row_chunk(rows, c):  # type: ignore[no-untyped-def]
    """Chunk number `c` of some rows."""
    return rows[c * rows.size // NUM_CHUNKS : (c + 1) * rows.size // NUM_CHUNKS]


@kernel(forceinline=True)
def interleave(r, count):  # type: ignore[no-untyped-def]
    """Which of `count` parts is number `r` in a loop that threads share: even ones first, then odd.

    A thread takes a run of numbers. Neighbours are alike, thick or thin, and go to different ones.
    """
    even = (count + 1) // 2
    return 2 * r if r < even else 2 * (r - even) + 1
