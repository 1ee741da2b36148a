"""What all kernels of `soil_sim.slope_failure` share: the rule, the columns that wait, and chance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel

__all__ = ["CellQueue", "RelaxationParameters", "StabilityLimits", "enqueue", "uniform"]


class StabilityLimits(NamedTuple):
    """How much higher than others a column may be by cohesion; see `soil_sim.slope_failure.stability`.

    Attributes:
        near: than the neighbours that soil slips to, by kind, moisture, number of the neighbour
            [m], shape (kinds, MOISTURE_LEVELS, n).
        offsets: (row, col) of columns farther away [cells], shape (m, 2); none if nothing coheres.
        far: than those [m], shape (kinds, MOISTURE_LEVELS, m).
    """

    neighbour_height: NDArray[np.float64]
    offsets: NDArray[np.int64]
    distant_height: NDArray[np.float64]


class RelaxationParameters(NamedTuple):
    """What decides whether a column's soil slips, and where it may go.

    Attributes:
        rows, cols: of the map.
        offsets: (row, col) of the neighbours [cells], shape (n, 2).
        distance: of each of them [m], shape (n,).
        reach: largest offset [cells].
        tolerance: excess of height left standing [m].
        slope: tangent of the angle of repose, by kind and moisture.
        faces: how high firm soil stands.
        steeper: tangent of each column's angle over that of its soil, flat; empty: 1.
        min_repose_tan: least tangent of any column at any moisture.
        uneven: how much chance there is in where soil slips to, 0 to 1.
        random: state of the random numbers, shape (1,), uint64.
    """

    rows: int
    cols: int
    offsets: NDArray[np.int64]
    distance: NDArray[np.float64]
    reach: int
    tolerance: float
    repose_tan: NDArray[np.float64]
    stability: StabilityLimits
    repose_tan_scale: NDArray[np.float64]
    min_repose_tan: float
    jitter: float
    random: NDArray[np.uint64]


class CellQueue(NamedTuple):
    """Columns that wait, first in, first out, none of them twice.

    Attributes:
        queue: flat indices, round and round.
        queued: 1 for those in it, flat, uint8.
        ends: where the first is, and where the next one goes.
    """

    buffer: NDArray[np.int64]
    is_queued: NDArray[np.uint8]
    head_tail: NDArray[np.int64]


@kernel(inline="always")
def uniform(random):  # type: ignore[no-untyped-def]
    """The next random number from 0 to 1 (xorshift64*, Vigna 2016); the state is changed."""
    x = random[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    random[0] = x
    return ((x * np.uint64(2685821657736338717)) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@helper(forceinline=True)
def enqueue(i, cell_queue):  # type: ignore[no-untyped-def]
    """Put a column into the ring if it is not there yet."""
    if cell_queue.is_queued[i] == 0:
        cell_queue.is_queued[i] = 1
        cell_queue.buffer[cell_queue.head_tail[1]] = i
        cell_queue.head_tail[1] = (cell_queue.head_tail[1] + 1) % cell_queue.buffer.size
