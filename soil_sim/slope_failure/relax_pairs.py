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


def pair_directions(
    neighbours: NDArray[np.int64], cell: float, tolerance: float, *, is_uniform: bool = True
) -> PairDirections:
    """Return the directions in which pairs are relaxed.

    Of two opposite directions one is sufficient. Of parallel ones, as (1, 0) and (2, 0), the
    shortest is, if all columns have one angle of repose; otherwise a column may be too steep
    against a distant one beyond a column that stands steeper.

    Args:
        neighbours: (row, col) of the neighbours that soil slides to [cells], shape (n, 2).
        cell: distance between columns [m].
        tolerance: excess of height that is not relaxed over the whole neighbourhood [m].
        is_uniform: whether all columns have one angle of repose.
    """
    offsets = np.array(
        [
            (int(di), int(dj))
            for di, dj in neighbours
            if (di > 0 or (di == 0 and dj > 0))
            and (not is_uniform or math.gcd(abs(int(di)), abs(int(dj))) == 1)
        ],
        dtype=np.int64,
    )
    repetitions = np.ones(len(offsets))
    if is_uniform:  # within a reach of 4, (1, 0) is applied four times: the excesses add up
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
                di, dj = offsets[k]
                half = (row // di if di > 0 else col // dj) % 2
                found[count, 0] = 2 * k + half
                found[count, 1], found[count, 2] = row * cols + col, to_row * cols + to_col
                count += 1
    return found[:count]


@kernel
def relax_pass(heights, floor, tangents, directions, retained, fraction, backward):  # type: ignore[no-untyped-def]
    """Relax all pairs of a window once, in every direction.

    Args:
        heights: surface [m], shape (rows, cols), float32; changed.
        floor: height below which a column cannot give soil [m], shape (rows, cols), float32.
        tangents: tangent of the angle of repose of each column, shape (rows, cols), float32.
        directions: `PairDirections`.
        retained: `RetainedPairs`.
        fraction: fraction of the excess that the higher column gives, float32.
        backward: whether to take the directions in reverse order.

    Returns:
        Whether any soil moved, int32.
    """
    rows, cols = heights.shape
    flat_heights = heights.reshape(-1)
    surface = (flat_heights, floor.reshape(-1), tangents.reshape(-1))
    count = directions.offsets.shape[0]
    has_moved = np.int32(0)
    heights_before = np.empty((retained.cells.shape[0], 2), np.float32)
    is_in_half, transfers = np.empty(cols, np.float32), np.empty(cols, np.float32)
    for n in range(count):
        k = count - 1 - n if backward else n
        di, dj = directions.offsets[k]
        if di >= rows or abs(dj) >= cols:
            continue
        first, end = max(0, -dj), min(cols, cols - dj)
        limit = (directions.distance[k], directions.tolerance[k], fraction)
        # No column is in two pairs at a time: one half of the pairs, then the other half.
        for half in range(2):
            group = retained.cells[
                retained.starts[2 * k + half] : retained.starts[2 * k + half + 1]
            ]
            _level(flat_heights, group, heights_before)
            if di == 0:
                _in_half(is_in_half, dj, half)
            for i in range(rows - di):
                a, b = np.uint64(i * cols + first), np.uint64((i + di) * cols + first + dj)
                if di == 0:
                    scratch = (is_in_half[: cols - dj], transfers[: cols - dj])
                    has_moved |= _relax_within_row(*surface, a, b, *scratch, *limit)
                elif (i // di) % 2 == half:
                    has_moved |= _relax_between_rows(*surface, a, b, np.uint64(end - first), *limit)
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
def _in_half(is_in_half, dj, half):  # type: ignore[no-untyped-def]
    """Write 1 for the first columns of the pairs of a half in a row, and 0 for all others."""
    for j in range(is_in_half.size):
        is_in_half[j] = (j // dj) % 2 == half


@helper
def _relax_between_rows(  # type: ignore[no-untyped-def]
    heights, floor, tangents, a, b, count, distance, tolerance, fraction
):
    """Relax the pairs of two rows, which begin at flat indices a and b.

    Flat arrays and unsigned indices, so that the loop is compiled to vector instructions.

    Returns:
        Whether any soil moved, int32.
    """
    has_moved = np.int32(0)
    for n in range(count):
        transfer = _transfer(heights, floor, tangents, a + n, b + n, distance, tolerance, fraction)
        has_moved |= np.int32(transfer != np.float32(0.0))
        heights[a + n] -= transfer
        heights[b + n] += transfer
    return has_moved


@helper
def _relax_within_row(  # type: ignore[no-untyped-def]
    heights, floor, tangents, a, b, is_in_half, transfers, distance, tolerance, fraction
):
    """Relax the pairs of columns in a row of which the first ones are marked.

    The transfers of all columns are computed, for vector instructions, and those of the pairs used.

    Args:
        heights, floor, tangents, distance, tolerance, fraction: see `relax_pass`.
        a, b: flat indices of the first column of the row and of its partner.
        is_in_half: see `_in_half`.
        transfers: scratch.

    Returns:
        Whether any soil moved, int32.
    """
    has_moved = np.int32(0)
    count = np.uint64(transfers.size)
    for n in range(count):
        transfer = is_in_half[n] * _transfer(
            heights, floor, tangents, a + n, b + n, distance, tolerance, fraction
        )
        has_moved |= np.int32(transfer != np.float32(0.0))
        transfers[n] = transfer
    for n in range(count):
        heights[a + n] -= transfers[n]
    for n in range(count):
        heights[b + n] += transfers[n]
    return has_moved


@helper(forceinline=True)
def _transfer(heights, floor, tangents, x, y, distance, tolerance, fraction):  # type: ignore[no-untyped-def]
    """Return the height [m] that column x gives to y, negative from y to x; without a branch."""
    zero = np.float32(0.0)
    drop = heights[x] - heights[y]
    available_x, available_y = heights[x] - floor[x], heights[y] - floor[y]
    available = available_x if drop > zero else available_y
    tangent_x, tangent_y = tangents[x], tangents[y]
    tangent = tangent_x if drop > zero else tangent_y
    excess = abs(drop) - tangent * distance
    transfer = fraction * excess
    transfer = available if available < transfer else transfer
    transfer = transfer if excess > tolerance else zero
    transfer = transfer if transfer > zero else zero
    return transfer if drop > zero else -transfer
