"""Kernels of relaxation passes: each relaxes all pairs of columns of a window once.

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

__all__ = ["PairDirections", "RetainedPairs", "pair_directions", "relax_passes", "retained_pairs"]

_INITIAL_FRACTION, _FINAL_FRACTION, _RAMP_PASSES = 0.5, 0.9, 8
"""Fraction of an excess that a column gives: first, later, and the number of passes between. A
larger fraction is faster, but a tall heap would spread too far at first."""


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


@helper(allocates=True)
def retained_pairs(is_wall, directions):  # type: ignore[no-untyped-def]
    """Return the `RetainedPairs` of a window.

    Args:
        is_wall: columns of the wall, shape (rows, cols).
        directions: `PairDirections`.
    """
    rows, cols = is_wall.shape
    offsets, between = directions.offsets, directions.between
    walls = _wall_faces(is_wall)
    found = np.empty((walls.shape[0] * offsets.shape[0] * between.shape[1], 2), dtype=np.int64)
    group = np.empty(found.shape[0], dtype=np.int64)
    starts = np.zeros(2 * offsets.shape[0] + 1, dtype=np.int64)
    count = 0
    for w in range(walls.shape[0]):
        for k in range(offsets.shape[0]):
            di, dj = offsets[k, 0], offsets[k, 1]
            for n in range(between.shape[1]):
                ar, ac = between[k, n, 0, 0], between[k, n, 0, 1]
                br, bc = between[k, n, 1, 0], between[k, n, 1, 1]
                if ar == 0 and ac == 0:
                    continue
                row, col = walls[w, 0] - ar, walls[w, 1] - ac
                to_row, to_col = row + di, col + dj
                if not (0 <= row < rows and 0 <= col < cols):
                    continue
                if not (0 <= to_row < rows and 0 <= to_col < cols):
                    continue
                if is_wall[row, col] or is_wall[to_row, to_col] or not is_wall[row + br, col + bc]:
                    continue
                half = (row // di if di > 0 else col // dj) % 2
                group[count] = 2 * k + half
                starts[group[count] + 1] += 1
                found[count, 0], found[count, 1] = row * cols + col, to_row * cols + to_col
                count += 1
    for g in range(starts.size - 1):
        starts[g + 1] += starts[g]
    cells, next_of_group = np.empty((count, 2), dtype=np.int64), starts.copy()
    for m in range(count):
        at = next_of_group[group[m]]
        cells[at, 0], cells[at, 1] = found[m, 0], found[m, 1]
        next_of_group[group[m]] += 1
    return RetainedPairs(cells, starts)


@helper(allocates=True)
def _wall_faces(is_wall):  # type: ignore[no-untyped-def]
    """Return (row, col) of the columns of a wall beside one that is not of it, shape (n, 2).

    Every line through the wall enters it in one of these.
    """
    rows, cols = is_wall.shape
    faces, count = np.empty((is_wall.size, 2), dtype=np.int64), 0
    for i in range(rows):
        for j in range(cols):
            if not is_wall[i, j]:
                continue
            is_inside = (
                (i == 0 or is_wall[i - 1, j])
                and (i == rows - 1 or is_wall[i + 1, j])
                and (j == 0 or is_wall[i, j - 1])
                and (j == cols - 1 or is_wall[i, j + 1])
            )
            if not is_inside:
                faces[count, 0], faces[count, 1] = i, j
                count += 1
    return faces[:count]


@kernel
def relax_passes(heights, floor, tangents, directions, retained, num_done, max_passes):  # type: ignore[no-untyped-def]
    """Relax all pairs of a window, pass by pass, until nothing moves.

    Pairs of rows in which nothing has moved since they were relaxed last are skipped: nothing would
    move between them.

    Args:
        heights: surface [m], shape (rows, cols), float32; changed.
        floor: height below which a column cannot give soil [m], shape (rows, cols), float32.
        tangents: tangent of the angle of repose of each column, shape (rows, cols), float32.
        directions: `PairDirections`.
        retained: `RetainedPairs`.
        num_done: number of passes over the failure in earlier calls.
        max_passes: maximum number of passes.

    Returns:
        (whether the last pass moved anything; number of passes).
    """
    # Times are numbers of steps; in a step, one half of the pairs of a direction is relaxed.
    moved_at = np.zeros(heights.shape[0], np.int64)
    relaxed_at = np.full(2 * directions.offsets.shape[0], -1, np.int64)
    step = 0
    for n in range(max_passes):
        ramp = min((num_done + n) / _RAMP_PASSES, 1.0)
        fraction = np.float32(_INITIAL_FRACTION + (_FINAL_FRACTION - _INITIAL_FRACTION) * ramp)
        has_moved = _relax_pass(
            heights, floor, tangents, directions, retained, fraction, (num_done + n) % 2 == 1,
            moved_at, relaxed_at, step,
        )  # fmt: skip
        if not has_moved:
            return False, n + 1
        step += relaxed_at.size
    return True, max_passes


@helper(allocates=True)
def _relax_pass(  # type: ignore[no-untyped-def]
    heights, floor, tangents, directions, retained, fraction, backward, moved_at, relaxed_at, step
):
    """Relax all pairs of a window once, in every direction.

    Args:
        heights, floor, tangents, directions, retained: see `relax_passes`.
        fraction: fraction of the excess that the higher column gives, float32.
        backward: whether to take the directions in reverse order.
        moved_at: step in which soil moved last in each row, shape (rows,); updated.
        relaxed_at: step in which each half of the pairs of each direction was relaxed last, -1 for
            never, shape (2 directions,); updated.
        step: number of the first step of the pass.

    Returns:
        Whether any soil moved.
    """
    rows, cols = heights.shape
    flat_heights = heights.reshape(-1)
    surface = (flat_heights, floor.reshape(-1), tangents.reshape(-1))
    count = directions.offsets.shape[0]
    has_moved = False
    heights_before = np.empty((retained.cells.shape[0], 2), np.float32)
    is_in_half, transfers = np.empty(cols, np.float32), np.empty(cols, np.float32)
    for n in range(count):
        k = count - 1 - n if backward else n
        di, dj = directions.offsets[k, 0], directions.offsets[k, 1]
        if di >= rows or abs(dj) >= cols:
            continue
        first, end = max(0, -dj), min(cols, cols - dj)
        limit = (directions.distance[k], directions.tolerance[k], fraction)
        # No column is in two pairs at a time: one half of the pairs, then the other half.
        for half in range(2):
            last = relaxed_at[2 * k + half]
            relaxed_at[2 * k + half] = step
            group = retained.cells[
                retained.starts[2 * k + half] : retained.starts[2 * k + half + 1]
            ]
            _level(flat_heights, group, heights_before)
            if di == 0:
                _in_half(is_in_half, dj, half)
            for i in range(rows - di):
                if max(moved_at[i], moved_at[i + di]) < last:
                    continue
                a, b = np.uint64(i * cols + first), np.uint64((i + di) * cols + first + dj)
                if di == 0:
                    scratch = (is_in_half[: cols - dj], transfers[: cols - dj])
                    moved = _relax_within_row(*surface, a, b, *scratch, *limit)
                elif (i // di) % 2 == half:
                    moved = _relax_between_rows(*surface, a, b, np.uint64(end - first), *limit)
                else:
                    continue
                if moved:
                    has_moved = True
                    moved_at[i] = moved_at[i + di] = step
            for m in range(group.shape[0]):
                for end_of_pair in range(2):
                    flat_heights[group[m, end_of_pair]] = heights_before[m, end_of_pair]
            step += 1
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
