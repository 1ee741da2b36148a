"""Kernels of a relaxation pass: relax all pairs of columns of a window once.

In every direction in which a neighbour can lie, the columns are divided into pairs, with no column
in two pairs at a time, and the higher column of a pair gives the excess of height to the lower one.
The inner loops are free of branches, so that they are compiled to vector instructions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel

__all__ = ["PairDirections", "pair_directions", "relax_pass"]


class PairDirections(NamedTuple):
    """Directions of the pairs of a pass.

    Attributes:
        offsets: (row, col) from a column to its partner [cells], shape (n, 2), int64.
        distance: distance of the partners [m], shape (n,), float32.
        tolerance: excess of height that is not relaxed [m], shape (n,), float32.
    """

    offsets: NDArray[np.int64]
    distance: NDArray[np.float32]
    tolerance: NDArray[np.float32]


def pair_directions(neighbours: NDArray[np.int64], cell: float, tolerance: float) -> PairDirections:
    """Return the directions in which pairs are relaxed.

    Of two opposite directions one is sufficient, and of parallel ones, as (1, 0) and (2, 0), the
    shortest.

    Args:
        neighbours: (row, col) of the neighbours that soil slides to [cells], shape (n, 2).
        cell: distance between columns [m].
        tolerance: excess of height that is not relaxed over the whole neighbourhood [m].
    """
    offsets = np.array(
        [
            (int(di), int(dj))
            for di, dj in neighbours
            if math.gcd(abs(int(di)), abs(int(dj))) == 1 and (di > 0 or (di == 0 and dj > 0))
        ],
        dtype=np.int64,
    )
    # Within a reach of 4, (1, 0) is applied four times in a row: the excesses add up.
    repetitions = int(np.abs(neighbours).max()) // np.abs(offsets).max(axis=1)
    return PairDirections(
        offsets,
        (np.hypot(*offsets.T) * cell).astype(np.float32),
        (tolerance / repetitions).astype(np.float32),
    )


@kernel
def relax_pass(heights, floor, directions, limits, fraction, backward):  # type: ignore[no-untyped-def]
    """Relax all pairs of a window once, in every direction.

    Args:
        heights: surface [m], shape (rows, cols), float32; changed.
        floor: height below which a column cannot give soil [m], shape (rows, cols), float32.
        directions: `PairDirections`.
        limits: difference of height at the angle of repose in each direction [m], float32.
        fraction: fraction of the excess that the higher column gives, float32.
        backward: whether to take the directions in reverse order.

    Returns:
        Whether any soil moved, int32.
    """
    rows, cols = heights.shape
    flat_heights, flat_floor = heights.reshape(-1), floor.reshape(-1)
    count = directions.offsets.shape[0]
    has_moved = np.int32(0)
    for n in range(count):
        k = count - 1 - n if backward else n
        di, dj = directions.offsets[k]
        if di >= rows or abs(dj) >= cols:
            continue
        first, end = max(0, -dj), min(cols, cols - dj)
        limit = (limits[k], directions.tolerance[k], fraction)
        # No column is in two pairs at a time: one half of the pairs, then the other half.
        for half in range(2):
            for i in range(rows - di):
                a = np.uint64(i * cols + first)
                if di == 0:
                    pairs = np.uint64((cols - half) // 2)
                    has_moved |= _relax_within_row(
                        flat_heights, flat_floor, a + np.uint64(half), pairs, *limit
                    )
                elif (i // di) % 2 == half:
                    b = np.uint64((i + di) * cols + first + dj)
                    has_moved |= _relax_between_rows(
                        flat_heights, flat_floor, a, b, np.uint64(end - first), *limit
                    )
    return has_moved


@helper
def _relax_between_rows(heights, floor, a, b, count, limit, tolerance, fraction):  # type: ignore[no-untyped-def]
    """Relax the pairs of two rows, which begin at flat indices a and b."""
    return _relax_pairs(heights, floor, a, b, np.uint64(1), count, limit, tolerance, fraction)


@helper
def _relax_within_row(heights, floor, a, count, limit, tolerance, fraction):  # type: ignore[no-untyped-def]
    """Relax the pairs of adjacent columns in a row: a with a + 1, a + 2 with a + 3 ..."""
    b, stride = a + np.uint64(1), np.uint64(2)
    return _relax_pairs(heights, floor, a, b, stride, count, limit, tolerance, fraction)


@helper(forceinline=True)
def _relax_pairs(heights, floor, a, b, stride, count, limit, tolerance, fraction):  # type: ignore[no-untyped-def]
    """Relax `count` pairs: a with b, a + stride with b + stride ...

    Flat arrays and unsigned indices, so that the loop is compiled to vector instructions.

    Returns:
        Whether any soil moved, int32.
    """
    has_moved = np.int32(0)
    for n in range(count):
        x, y = a + n * stride, b + n * stride
        height_x, height_y = heights[x], heights[y]
        transfer = _transfer(
            height_x - height_y,
            height_x - floor[x],
            height_y - floor[y],
            limit,
            tolerance,
            fraction,
        )
        has_moved |= np.int32(transfer != np.float32(0.0))
        heights[x] = height_x - transfer
        heights[y] = height_y + transfer
    return has_moved


@helper(forceinline=True)
def _transfer(drop, available_x, available_y, limit, tolerance, fraction):  # type: ignore[no-untyped-def]
    """Return the height [m] that x gives to y, negative from y to x; without a branch.

    `drop` is how much higher x is than y [m], and `available` is what each of them can give [m].
    """
    zero = np.float32(0.0)
    available = available_x if drop > zero else available_y
    excess = abs(drop) - limit
    transfer = fraction * excess
    transfer = available if available < transfer else transfer
    transfer = transfer if excess > tolerance else zero
    transfer = transfer if transfer > zero else zero
    return transfer if drop > zero else -transfer
