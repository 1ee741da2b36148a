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
from soil_sim.slope_failure.neighbourhood import columns_between

__all__ = ["PairDirections", "RetainedPairs", "pair_directions", "relax_pass", "retained_pairs"]


class PairDirections(NamedTuple):
    """Directions of the pairs of a pass.

    Attributes:
        offsets: (row, col) from a column to its partner [cells], shape (n, 2), int64.
        distance: distance of the partners [m], shape (n,), float32.
        tolerance: excess of height that is not relaxed [m], shape (n,), float32.
        between: columns between the partners, see `columns_between`.
    """

    offsets: NDArray[np.int64]
    distance: NDArray[np.float32]
    tolerance: NDArray[np.float32]
    between: NDArray[np.int64]


class RetainedPairs(NamedTuple):
    """Pairs between which a wall is, so that no soil slides.

    Attributes:
        cells: flat indices of the columns of each pair, shape (n, 2), int64; may have duplicates.
        starts: index of the first pair of each half of the pairs of each direction, in their order,
            and the number of pairs, shape (2 directions + 1,), int64.
    """

    cells: NDArray[np.int64]
    starts: NDArray[np.int64]


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
        columns_between(offsets),
    )


def retained_pairs(is_wall: NDArray[np.bool_], directions: PairDirections) -> RetainedPairs:
    """Return the pairs of a window between which a wall is.

    Args:
        is_wall: columns of the wall, shape (rows, cols).
        directions: directions of the pairs.
    """
    starts = np.zeros(2 * len(directions.offsets) + 1, dtype=np.int64)
    if not is_wall.any():
        return RetainedPairs(np.zeros((0, 2), dtype=np.int64), starts)
    walls = np.ascontiguousarray(np.argwhere(is_wall))
    found = _find_retained(is_wall, walls, directions.offsets, directions.between)
    group = found[:, 0]
    starts[1:] = np.cumsum(np.bincount(group, minlength=starts.size - 1))
    return RetainedPairs(found[np.argsort(group, kind="stable"), 1:], starts)


@kernel
def _find_retained(is_wall, walls, offsets, between):  # type: ignore[no-untyped-def]
    """Return (number of the half of the direction, flat indices of both columns) of each pair."""
    rows, cols = is_wall.shape
    found = np.empty((walls.shape[0] * offsets.shape[0] * between.shape[1], 3), dtype=np.int64)
    count = 0
    for w in range(walls.shape[0]):
        for k in range(offsets.shape[0]):
            for n in range(between.shape[1]):
                (ar, ac), (br, bc) = between[k, n]
                if ar == 0 and ac == 0:
                    continue
                row, col = walls[w, 0] - ar, walls[w, 1] - ac
                to_row, to_col = row + offsets[k, 0], col + offsets[k, 1]
                if not (0 <= row < rows and 0 <= col < cols):
                    continue
                if not (0 <= to_row < rows and 0 <= to_col < cols):
                    continue
                if is_wall[row, col] or is_wall[to_row, to_col] or not is_wall[row + br, col + bc]:
                    continue
                half = (row // offsets[k, 0]) % 2 if offsets[k, 0] > 0 else (col % 2)
                found[count, 0] = 2 * k + half
                found[count, 1], found[count, 2] = row * cols + col, to_row * cols + to_col
                count += 1
    return found[:count]


@kernel
def relax_pass(heights, floor, directions, retained, limits, fraction, backward):  # type: ignore[no-untyped-def]
    """Relax all pairs of a window once, in every direction.

    Args:
        heights: surface [m], shape (rows, cols), float32; changed.
        floor: height below which a column cannot give soil [m], shape (rows, cols), float32.
        directions: `PairDirections`.
        retained: `RetainedPairs`.
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
    heights_before = np.empty((retained.cells.shape[0], 2), np.float32)
    for n in range(count):
        k = count - 1 - n if backward else n
        di, dj = directions.offsets[k]
        if di >= rows or abs(dj) >= cols:
            continue
        first, end = max(0, -dj), min(cols, cols - dj)
        limit = (limits[k], directions.tolerance[k], fraction)
        # No column is in two pairs at a time: one half of the pairs, then the other half.
        for half in range(2):
            group = retained.cells[
                retained.starts[2 * k + half] : retained.starts[2 * k + half + 1]
            ]
            _level(flat_heights, group, heights_before)
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
            for m in range(group.shape[0]):
                for end_of_pair in range(2):
                    flat_heights[group[m, end_of_pair]] = heights_before[m, end_of_pair]
    return has_moved


@helper
def _level(heights, pairs, heights_before):  # type: ignore[no-untyped-def]
    """Level the columns of pairs, so that no soil moves between them, and keep their heights."""
    for m in range(pairs.shape[0]):
        for end in range(2):
            heights_before[m, end] = heights[pairs[m, end]]
    for m in range(pairs.shape[0]):
        heights[pairs[m, 0]] = heights[pairs[m, 1]] = np.float32(0.0)


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
