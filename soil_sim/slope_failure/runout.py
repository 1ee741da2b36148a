"""Runout: soil deposited on a slope runs down it and stays where it can (reference, 3.1.2).

The soil that exceeds what a column can hold moves, all of it, to the neighbour it exceeds the angle
of repose against by most (or by almost as much, if that is farther), and from there to the next;
what a column can hold stays on it. Only the deposited soil moves: no column becomes lower than it
was, so none above it becomes unstable, and no column is visited twice. This is much less work than
to relax all columns that gave or received soil (`soil_sim.slope_failure.relax_cells`), and as good
as long as a thin layer runs down at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import fixed_signature_kernel, helper
from soil_sim.columns.occupancy import TOOL_INSIDE
from soil_sim.columns.operations import add_loose
from soil_sim.slope_failure.cell_queue import enqueue
from soil_sim.slope_failure.neighbourhood import is_tool_between
from soil_sim.slope_failure.noise import random_uniform

__all__ = ["ColumnShares", "deposit_with_runout", "join_shares"]

_MIN_LAYER, _MAX_LAYER = 0.05, 0.5
"""Limits of the thickness of the layer that runs down at once [cells]. A thicker layer is faster,
and leaves the slope less even and less steep by half of the thickness."""

_LAYER_DIVISOR = 24
"""Between the limits, the remaining volume over this runs down at once: the last layer is thin."""

_ROLL_ON_FRACTION = 0.3
"""Maximum random reduction of the slope by which soil moves on where it could stay, at `jitter` 1,
as a fraction of the slope."""

_DISTANCE_PREFERENCE = 0.01
"""Increase of the score of a neighbour per metre of distance: of neighbours with about the same
excess, soil moves to the farthest. On a slope at its angle of repose all are the same. Not used at
the edge of the map, nor where columns differ by noise."""


class ColumnShares(NamedTuple):
    """Soil to add to columns: particles that came to rest and soil that tools have displaced.

    A particle has four shares, one for each of its columns; a record of displaced soil has one.

    Attributes:
        cells: flat indices of the columns, shape (n,), int64; may contain duplicates.
        volume_mm3: bank volumes [mm^3], shape (n,), int64; some may be 0.
        soil: kinds by id, shape (n,), uint8.
        moisture: moistures [%], shape (n,), uint8.
    """

    cells: NDArray[np.int64]
    volume_mm3: NDArray[np.int64]
    soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]


def join_shares(parts: Sequence[ColumnShares]) -> ColumnShares:
    """Return the concatenation of shares."""
    return ColumnShares(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


@fixed_signature_kernel
def deposit_with_runout(slopes, shares, first_index, budget):  # type: ignore[no-untyped-def]
    """Add loose soil to columns and let it run out, in at most about `budget` steps.

    1. Take one layer of each share in turn, until no share has volume left.
    2. On the column of the layer, find the neighbour that the surface with the layer exceeds by
       most. The part of the layer that exceeds it moves there.
    3. Add the other part to the column. Enqueue the column if the loose soil on it may stand less
       steeply than the deposited soil.
    4. Continue with step 2 for the part that moves, on the column that it has moved to, until
       nothing moves.

    When the budget is spent, the remaining soil is added where it is, and the columns enqueued.

    Args:
        slopes: `SlopeArrays`, boxed; the columns and the queue are changed.
        shares: `ColumnShares` to deposit; their volumes are set to 0.
        first_index: scratch array of zeros, shape (columns,), int32; zeros again afterwards.
        budget: number of steps.

    Returns:
        The number of steps: moves from a column to a neighbour.
    """
    _, params, _, _ = slopes.table
    _merge_duplicates(shares, first_index)
    index_offset, between, preference = _list_neighbours(params)
    count = params.distance.size
    pending = np.arange(shares.cells.size)
    limit, scores = np.empty(2 * count), np.empty(count)
    if params.repose_tan_scale.size == 0:  # compiled without noise, which takes less time
        return _deposit_layers(
            slopes.table, shares, budget, pending, index_offset, between, preference, limit, scores,
            None,
        )  # fmt: skip
    preference[:] = 0.0
    return _deposit_layers(
        slopes.table, shares, budget, pending, index_offset, between, preference, limit, scores,
        params.repose_tan_scale,
    )  # fmt: skip


@helper
def _deposit_layers(  # type: ignore[no-untyped-def]
    slopes, shares, budget, pending, index_offset, between, preference, limit, scores,
    repose_tan_scale,
):  # fmt: skip
    """Deposit the shares layer by layer, without counts of references; return the number of steps.

    Args:
        slopes, shares, budget: see `deposit_with_runout`.
        pending: indices of all shares; changed.
        index_offset, between, preference: see `_list_neighbours`.
        limit: scratch, shape (2 n,).
        scores: scratch, shape (n,).
        repose_tan_scale: see `RelaxationParameters`; None if it is 1 everywhere.
    """
    columns, params, occupied, queue = slopes
    cells, volumes, soils, moistures = shares
    height, repose_tan, tolerance = columns.height, params.repose_tan, params.tolerance
    rows, cols, reach, count = params.rows, params.cols, params.reach, params.distance.size
    thin, thick = _MIN_LAYER * params.distance[0], _MAX_LAYER * params.distance[0]
    is_even = params.jitter == 0.0
    num_pending = _keep_pending(volumes, pending, pending.size)
    steps = 0
    limit_tangent = np.nan
    while num_pending:
        # One layer of each in turn, so that the soil of many columns rises everywhere at once.
        for n in range(num_pending):
            m = pending[n]
            i, soil, moisture = cells[m], soils[m], moistures[m]
            bulking_factor, tangent = columns.bulking_factor[soil], repose_tan[soil, moisture]
            # With noise the limits are distances, to be multiplied by the tangent of each column.
            listed_tangent = tangent if repose_tan_scale is None else 1.0
            if listed_tangent != limit_tangent:
                _set_limits(limit, params, listed_tangent)
                limit_tangent = listed_tangent
            metres = bulking_factor * columns.metres_per_mm3
            volume = volumes[m]
            if steps < budget:
                layer = min(max(volume / _LAYER_DIVISOR, thin / metres), thick / metres)
                volume = min(np.int64(layer) + 1, volume)
            volumes[m] -= volume
            while volume > 0:
                target, moving = np.int64(-1), np.int64(0)
                if steps < budget and occupied[i] != TOOL_INSIDE:
                    top = height[i] + volume * metres
                    row = i // cols
                    col = i - row * cols
                    is_interior = reach <= row < rows - reach and reach <= col < cols - reach
                    if is_even and is_interior:
                        factor = 1.0 if repose_tan_scale is None else tangent * repose_tan_scale[i]
                        target, max_excess = _find_interior_target(
                            height, occupied, index_offset, between, preference, limit, factor,
                            scores, i, top, count * (steps % 2), tolerance,
                        )  # fmt: skip
                    else:
                        target, max_excess = _find_target(
                            height, params, occupied, i, top, tangent, steps % 2 == 0
                        )
                    if target >= 0:
                        moving = min(np.int64(max_excess / metres), volume)
                staying = volume - moving
                if staying > 0:
                    bulk = np.int64(staying * bulking_factor + 0.5)
                    add_loose(columns, i, staying, bulk, soil, moisture)
                    loose_tangent = repose_tan[columns.loose_soil[i], columns.loose_moisture[i]]
                    if loose_tangent != tangent or steps >= budget:
                        enqueue(queue, i)  # it may stand less steeply than the deposited soil
                steps += 1
                i, volume = target, moving
        num_pending = _keep_pending(volumes, pending, num_pending)
    return steps


@helper
def _merge_duplicates(shares, first_index):  # type: ignore[no-untyped-def]
    """Add the volume of shares of one column, kind and moisture to the first of them."""
    for m in range(shares.cells.size):
        first = first_index[shares.cells[m]] - 1
        if first < 0:
            first_index[shares.cells[m]] = m + 1
        elif shares.soil[first] == shares.soil[m] and shares.moisture[first] == shares.moisture[m]:
            shares.volume_mm3[first] += shares.volume_mm3[m]
            shares.volume_mm3[m] = 0
    for m in range(shares.cells.size):
        first_index[shares.cells[m]] = 0


@helper
def _keep_pending(volumes, pending, count):  # type: ignore[no-untyped-def]
    """Move those of `count` pending shares that have volume to the front; return their number.

    `volumes` are those of all shares [mm^3], and `pending` are indices of shares.
    """
    kept = 0
    for n in range(count):
        if volumes[pending[n]] > 0:
            pending[kept] = pending[n]
            kept += 1
    return kept


@helper(allocates=True)
def _list_neighbours(params):  # type: ignore[no-untyped-def]
    """List the neighbours of an interior column twice: forward, then backward.

    Searches start alternately at the first and at the second list: ties go to alternate ends, or a
    heap would drift to one side.

    Returns:
        (offset of the flat index, shape (2 n,), int64; columns between, see
        `RelaxationParameters`, shape (2 n, m, 2); increase of the score, shape (2 n,)).
    """
    count = params.distance.size
    index_offset, preference = np.empty(2 * count, dtype=np.int64), np.empty(2 * count)
    between = np.concatenate((params.between, params.between[::-1]))
    for k in range(count):
        back = 2 * count - 1 - k
        offset = params.offsets[k, 0] * params.cols + params.offsets[k, 1]
        index_offset[k] = index_offset[back] = offset
        preference[k] = preference[back] = _DISTANCE_PREFERENCE * params.distance[k]
    return index_offset, between, preference


@helper
def _set_limits(limit, params, tangent):  # type: ignore[no-untyped-def]
    """Set the rise to each listed neighbour [m] at the tangent of an angle of repose."""
    count = params.distance.size
    for k in range(count):
        limit[k] = limit[2 * count - 1 - k] = tangent * params.distance[k]


@helper(forceinline=True)
def _find_interior_target(  # type: ignore[no-untyped-def]
    height, occupied, index_offset, between, preference, limit, factor, scores, i, top, first,
    tolerance,
):  # fmt: skip
    """Find the neighbour that soil up to `top` [m] on an interior column moves to.

    For soil that does not slide at random. The loop over the neighbours has no branches and
    unsigned indices (`msg_bridge.kernels.decorators`): it is most of the time of a deposit. A
    condition would be compiled to a branch, which on a slope at its angle of repose is predicted
    wrong again and again; a score is multiplied by it instead.

    Args:
        height: surface of each column [m], flat.
        occupied: marks of `columns.occupancy`, flat, uint8.
        index_offset, between, preference: see `_list_neighbours`.
        limit: see `_set_limits`.
        factor: the rise to a neighbour is this times its limit.
        scores: scratch, shape (n,).
        i: flat index of the column.
        top: surface of the column with the soil [m].
        first: number of the listed neighbour at which the search starts.
        tolerance: excess that does not count [m].

    Returns:
        (flat index of the neighbour with the maximum score, -1 if there is none; maximum excess
        [m]).
    """
    max_excess = max_score = 0.0
    marks = np.uint8(0)
    for k in range(scores.size):
        n = np.uint64(first + k)
        j = np.uint64(i + index_offset[n])
        excess = top - height[j] - factor * limit[n]
        scores[k] = (excess + preference[n]) * (excess > tolerance)
        max_excess = max(max_excess, excess)
        max_score = max(max_score, scores[k])
        marks |= occupied[j]
    if marks != 0:
        max_excess = max_score = 0.0
        for k in range(scores.size):
            j = i + index_offset[first + k]
            if occupied[j] != 0 or is_tool_between(occupied, between, i, first + k):
                scores[k] = 0.0
            elif scores[k] > 0.0:
                max_excess = max(max_excess, top - height[j] - factor * limit[first + k])
                max_score = max(max_score, scores[k])
    if max_score == 0.0:
        return np.int64(-1), 0.0
    k = 0
    while scores[k] != max_score:
        k += 1
    return i + index_offset[first + k], max_excess


@helper
def _find_target(height, params, occupied, i, top, tangent, forward):  # type: ignore[no-untyped-def]
    """Find the neighbour that soil up to `top` [m] on column i exceeds its slope against by most.

    For the edge of the map, and for soil that slides at random (`RelaxationNoise.jitter`).

    Returns:
        (flat index of the neighbour, -1 if there is none; excess over it [m]).
    """
    if params.repose_tan_scale.size:
        tangent *= params.repose_tan_scale[i]
    if params.jitter > 0.0:
        tangent *= 1.0 - _ROLL_ON_FRACTION * params.jitter * random_uniform(params.random_state)
    row, col = i // params.cols, i % params.cols
    target = np.int64(-1)
    max_excess = params.tolerance
    count = params.distance.size
    for n in range(count):
        k = n if forward else count - 1 - n
        r, c = row + params.offsets[k, 0], col + params.offsets[k, 1]
        if r < 0 or r >= params.rows or c < 0 or c >= params.cols:
            continue
        j = r * params.cols + c
        excess = top - height[j] - tangent * params.distance[k]
        if excess > max_excess and occupied[j] == 0:
            if is_tool_between(occupied, params.between, i, k):
                continue
            max_excess, target = excess, j
    return target, max_excess
