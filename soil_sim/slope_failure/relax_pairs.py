"""Kernels of relaxation passes: each relaxes all pairs of columns of a window once.

In every direction in which a neighbour can lie, the columns are divided into pairs, with no column
in two pairs at a time, and the higher column of a pair gives the excess of height to the lower one.
Pairs of two rows are relaxed block by block (`soil_sim.slope_failure.pair_blocks`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.slope_failure.neighbourhood import columns_between
from soil_sim.slope_failure.pair_blocks import BLOCK_SIZE, relax_block, steep_pairs
from soil_sim.slope_failure.window_surface import relaxed_cols

__all__ = ["PairDirections", "pair_directions", "relax_passes"]

_INITIAL_FRACTION, _FINAL_FRACTION, _RAMP_PASSES = 0.5, 0.9, 8
"""Fraction of an excess that a column gives: first, later, and the number of passes between. A
larger fraction is faster, but a tall heap would spread too far at first."""

_FINAL_FRACTION_OF_VARYING = 0.95
"""The later fraction where angles of repose vary: slopes come to rest there in more passes."""


class PairDirections(NamedTuple):
    """Directions of the pairs of a pass.

    Attributes:
        offsets: (row, col) from a column to its partner [cells], shape (n, 2), int64. Those that
            are parallel to a shorter one come last.
        num_shortest: number of the others.
        distance: distance of the partners [m], shape (n,), float32.
        tolerance: excess of height that is not relaxed [m], shape (n,), float32.
        between: columns between the partners, see `columns_between`.
        final_fraction: fraction of an excess that a column gives in later passes.
    """

    offsets: NDArray[np.int64]
    num_shortest: int
    distance: NDArray[np.float32]
    tolerance: NDArray[np.float32]
    between: NDArray[np.int64]
    final_fraction: float


class _Scratch(NamedTuple):
    """What the passes over a window keep. Times are numbers of steps; a step relaxes one half.

    Attributes:
        moved_at: step in which soil moved last in each row, -1 for never, shape (rows,), int64.
        relaxed_at: step in which each half of the pairs of each direction was relaxed last, -1 for
            never, shape (2 directions,), int64.
        heights_before: heights of the columns of retained pairs, shape (pairs, 2), float32.
        is_first: bits of the first columns of the pairs of each half within a row, block by block,
            shape (2 directions * blocks of a row,), uint16.
    """

    moved_at: NDArray[np.int64]
    relaxed_at: NDArray[np.int64]
    heights_before: NDArray[np.float32]
    is_first: NDArray[np.uint16]


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
    halves = [(di, dj) for di, dj in neighbours.tolist() if di > 0 or (di == 0 and dj > 0)]
    shortest = [each for each in halves if math.gcd(*each) == 1]
    others = [] if is_uniform else [each for each in halves if math.gcd(*each) > 1]
    offsets = np.array(shortest + others, dtype=np.int64)
    repetitions = np.ones(len(offsets))
    if is_uniform:  # within a reach of 4, (1, 0) is applied four times: the excesses add up
        repetitions = int(np.abs(neighbours).max()) // np.abs(offsets).max(axis=1)
    return PairDirections(
        offsets,
        len(shortest),
        (np.hypot(*offsets.T) * cell).astype(np.float32),
        (tolerance / repetitions).astype(np.float32),
        columns_between(offsets),
        _FINAL_FRACTION if is_uniform else _FINAL_FRACTION_OF_VARYING,
    )


@kernel
def relax_passes(heights, surface, directions, retained, num_done, max_passes):  # type: ignore[no-untyped-def]
    """Relax all pairs of a window, pass by pass, until nothing moves.

    Pairs of rows in which nothing has moved since they were relaxed last are skipped: nothing would
    move between them. In directions that are parallel to a shorter one, little moves: their pairs
    are relaxed in every second pass only.

    Args:
        heights: surface [m], shape (rows, padded cols), float32; changed.
        surface: `WindowSurface`; its own heights are not used.
        directions: `PairDirections`.
        retained: `RetainedPairs`.
        num_done: number of passes over the failure in earlier calls.
        max_passes: maximum number of passes.

    Returns:
        (whether the last pass moved anything; number of passes).
    """
    flat, progress = heights.reshape(-1), (num_done, max_passes)
    if surface.is_uniform and surface.is_bottomless:
        # The same numbers as below, in less time: without layers that change nothing.
        return _relax_passes(
            (flat, None, None), heights.shape, surface.num_cols, directions,
            surface.tangent * directions.distance, retained, progress,
        )  # fmt: skip
    tangents = surface.tangents.reshape(-1)
    if surface.is_bottomless:
        return _relax_passes(
            (flat, None, tangents), heights.shape, surface.num_cols, directions,
            directions.distance, retained, progress,
        )  # fmt: skip
    layers = (flat, surface.floor.reshape(-1), tangents)
    return _relax_passes(
        layers, heights.shape, surface.num_cols, directions, directions.distance, retained, progress
    )


@helper(allocates=True)
def _relax_passes(layers, shape, num_cols, directions, distance, retained, progress):  # type: ignore[no-untyped-def]
    """Relax as `relax_passes`.

    Args:
        layers: (heights, floor, tangents), see `WindowSurface`, flat; the heights are changed. With
            None for floor or tangents, the whole surface has no floor, or one tangent.
        shape: rows and padded columns of the layers.
        num_cols: number of columns without those that pad the rows.
        directions, retained: see `relax_passes`.
        distance: distance of the partners in each direction [m], shape (n,), float32; without
            tangents, the drop between them that is stable [m].
        progress: (`num_done`, `max_passes`) of `relax_passes`.
    """
    halves = 2 * distance.size
    scratch = _Scratch(
        np.full(shape[0], -1, np.int64),
        np.full(halves, -1, np.int64),
        np.empty((retained.cells.shape[0], 2), np.float32),
        _first_columns(directions.offsets, relaxed_cols(num_cols)),
    )
    num_done, max_passes = progress
    for n in range(max_passes):
        ramp = min((num_done + n) / _RAMP_PASSES, 1.0)
        fraction = np.float32(
            _INITIAL_FRACTION + (directions.final_fraction - _INITIAL_FRACTION) * ramp
        )
        is_odd = (num_done + n) % 2 == 1
        count = distance.size if is_odd else directions.num_shortest
        has_moved = _relax_pass(
            layers, shape, num_cols, directions, distance, retained, fraction, count, is_odd,
            scratch, n * halves,
        )  # fmt: skip
        if not has_moved and count == distance.size:
            return False, n + 1
    return True, max_passes


@helper(allocates=True)
def _first_columns(offsets, cols):  # type: ignore[no-untyped-def]
    """Return `_Scratch.is_first` for directions by their `offsets` and rows of `cols` columns."""
    num_blocks = cols // BLOCK_SIZE
    is_first = np.zeros(2 * offsets.shape[0] * num_blocks, np.uint16)
    for k in range(offsets.shape[0]):
        di, dj = offsets[k, 0], offsets[k, 1]
        if di == 0:
            for half in range(2):
                bit, remaining = 1 - half, dj  # of dj columns in turn
                for j in range(num_blocks * BLOCK_SIZE):
                    if remaining == 0:
                        bit, remaining = 1 - bit, dj
                    block = (2 * k + half) * num_blocks + j // BLOCK_SIZE
                    is_first[block] |= np.uint16(bit << j % BLOCK_SIZE)
                    remaining -= 1
    return is_first


@helper
def _relax_pass(  # type: ignore[no-untyped-def]
    layers, shape, num_cols, directions, distance, retained, fraction, count, backward, scratch,
    step,
):  # fmt: skip
    """Relax all pairs of a window once, in some directions.

    The whole width of padded rows is relaxed, for vector instructions: no soil moves to or from the
    columns that pad them, nor from one row to the next through these.

    Args:
        layers, shape, num_cols, directions, distance, retained: see `_relax_passes`.
        fraction: fraction of the excess that the higher column gives, float32.
        count: number of the directions, of those in `directions` the first ones.
        backward: whether to take them in reverse order.
        scratch: `_Scratch`.
        step: number of the first step of the pass.

    Returns:
        Whether any soil moved.
    """
    heights, relaxed_at, starts = layers[0], scratch.relaxed_at, retained.starts
    has_moved = False
    width = relaxed_cols(num_cols)
    for n in range(count):
        k = count - 1 - n if backward else n
        di, dj = directions.offsets[k, 0], directions.offsets[k, 1]
        if di >= shape[0] or abs(dj) >= num_cols:
            continue
        limit = (distance[k], directions.tolerance[k], fraction)
        # No column is in two pairs at a time: one half of the pairs, then the other half.
        for half in range(2 * k, 2 * k + 2):
            last = relaxed_at[half]
            relaxed_at[half] = step
            first, end = starts[half], starts[half + 1]
            _level(heights, retained.cells, first, end, scratch.heights_before)
            has_moved |= _relax_half(layers, shape, width, di, dj, half, limit, scratch, last, step)
            for m in range(first, end):
                for end_of_pair in range(2):
                    heights[retained.cells[m, end_of_pair]] = scratch.heights_before[m, end_of_pair]
            step += 1
    return has_moved


@helper
def _level(heights, pairs, first, end, heights_before):  # type: ignore[no-untyped-def]
    """Level the columns of some pairs, so that no soil moves between them; keep their heights."""
    for m in range(first, end):
        for end_of_pair in range(2):
            heights_before[m, end_of_pair] = heights[pairs[m, end_of_pair]]
    for m in range(first, end):
        heights[pairs[m, 0]] = heights[pairs[m, 1]] = np.float32(0.0)


@helper
def _relax_half(layers, shape, width, di, dj, half, limit, scratch, last, step):  # type: ignore[no-untyped-def]
    """Relax one half of the pairs of a direction, unless their rows are as they were before.

    Args:
        layers, shape: see `_relax_passes`.
        width: number of pairs in a row.
        di, dj: rows and columns from a column to its partner.
        half: number of the half, among those of all directions.
        limit: see `_relax_rows`.
        scratch: `_Scratch`.
        last, step: steps in which the half was relaxed last, and in which it is now.

    Returns:
        Whether any soil moved.
    """
    moved_at = scratch.moved_at
    has_moved = False
    # Unsigned, see `msg_bridge.kernels.decorators`.
    stride, num_pairs, row_step = np.uint64(shape[1]), np.uint64(width), np.uint64(di)
    end = np.uint64(shape[0] - di)
    first = row_step * np.uint64(half % 2)
    run = row_step if di > 0 else end
    marks = np.uint64(half) * (num_pairs // np.uint64(BLOCK_SIZE))
    while first < end:
        for i in range(first, min(first + run, end)):
            to = i + row_step
            if moved_at[i] < last and moved_at[to] < last:
                continue
            a, b = i * stride, to * stride + np.uint64(dj)
            if di == 0:
                moved = _relax_rows(layers, a, b, num_pairs, limit, scratch.is_first, marks)
            else:
                moved = _relax_rows(layers, a, b, num_pairs, limit, None, marks)
            if moved:
                has_moved = True
                moved_at[i] = moved_at[to] = step
        first += np.uint64(2) * run
    return has_moved


@helper(forceinline=True)
def _relax_rows(layers, a, b, width, limit, is_first, marks):  # type: ignore[no-untyped-def]
    """Relax the pairs of two rows, or within a row, which begin at flat indices a and b.

    Args:
        layers: see `_relax_passes`.
        a, b: flat indices of the first columns, uint64.
        width: number of pairs, uint64.
        limit: (distance of the columns, or drop between them that is stable [m]; tolerance [m];
            fraction of the excess that the higher column gives), float32.
        is_first: see `_Scratch`; None for the pairs of two rows.
        marks: index in it of the bits of the first block, uint64.

    Returns:
        Whether any soil moved.
    """
    heights, floor, tangents = layers
    stable_drop, tolerance, fraction = limit
    has_moved = False
    for k in range(width // np.uint64(BLOCK_SIZE)):
        x, y = a + k * np.uint64(BLOCK_SIZE), b + k * np.uint64(BLOCK_SIZE)
        steep = steep_pairs(heights, tangents, x, y, stable_drop, tolerance)
        if is_first is not None:  # when compiled
            steep = np.uint16(steep & is_first[marks + k])
        if steep != 0:  # of few blocks, once most soil is at rest
            moved = relax_block(heights, floor, tangents, x, y, stable_drop, fraction, steep)
            has_moved |= moved != 0
    return has_moved
