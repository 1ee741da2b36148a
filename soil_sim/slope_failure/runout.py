"""Runout: soil deposited on a slope runs down it and stays where it can (reference, 3.1.2).

The soil that exceeds what a column can hold moves, all of it, to the neighbour it exceeds the angle
of repose against by most (or by almost as much, if that is farther), and from there to the next;
what a column can hold stays on it. Only the deposited soil moves: no column becomes lower than it
was, so none above it becomes unstable, and no column is visited twice. This is much less work than
to relax all columns that gave or received soil (`soil_sim.slope_failure.relax_cells`), and as good
as long as a thin layer runs down at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.operations import add_loose
from soil_sim.slope_failure.cell_queue import enqueue
from soil_sim.slope_failure.noise import random_uniform

__all__ = ["deposit_with_runout"]

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


class _Neighbours(NamedTuple):
    """Neighbours of an interior column, listed twice: forward, then backward.

    Searches start alternately at the first and at the second list: ties go to alternate ends, or a
    heap would drift to one side.

    Attributes:
        index_offset: offset of the flat index, shape (2 n,), int64.
        preference: increase of the score with the distance [m], shape (2 n,), float64.
        limit: rise to the column at the angle of repose [m], shape (2 n,), float64.
    """

    index_offset: NDArray[np.int64]
    preference: NDArray[np.float64]
    limit: NDArray[np.float64]


@kernel
def deposit_with_runout(columns, params, occupied, queue, shares, first_index, budget):  # type: ignore[no-untyped-def]
    """Add loose soil to columns and let it run out, in at most about `budget` steps.

    Soil that remains when the budget is spent is deposited where it is, and the column enqueued.

    Args:
        columns: `ColumnArrays` of the terrain; changed.
        params: `RelaxationParameters`.
        occupied: 1 for columns that do not receive soil from others, flat, uint8.
        queue: the `CellQueue`; changed.
        shares: `ColumnShares` to deposit; their volumes are set to 0.
        first_index: scratch array of zeros, shape (columns,), int32; zeros again afterwards.
        budget: number of steps.

    Returns:
        The number of steps: moves from a column to a neighbour.
    """
    _merge_duplicates(shares, first_index)
    neighbours = _list_neighbours(params)
    steps = 0
    pending, num_pending = np.empty(shares.cells.size, dtype=np.int64), 0
    for m in range(shares.cells.size):
        first_index[shares.cells[m]] = 0
        if shares.volume_mm3[m] != 0:
            pending[num_pending] = m
            num_pending += 1
    limit_tangent = np.nan
    while num_pending:
        # One layer of each in turn, so that the soil of many columns rises everywhere at once.
        for n in range(num_pending):
            m = pending[n]
            tangent = params.repose_tan[shares.soil[m], shares.moisture[m]]
            if tangent != limit_tangent:
                _set_limits(neighbours, params, tangent)
                limit_tangent = tangent
            volume = shares.volume_mm3[m]
            if steps < budget:
                volume = min(_layer_volume(columns, params, volume, shares.soil[m]), volume)
            shares.volume_mm3[m] -= volume
            steps = _run_down(
                columns, params, occupied, queue, neighbours, shares, m, volume, steps, budget
            )
        count, num_pending = num_pending, 0
        for n in range(count):
            if shares.volume_mm3[pending[n]] > 0:
                pending[num_pending] = pending[n]
                num_pending += 1
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


@helper
def _list_neighbours(params):  # type: ignore[no-untyped-def]
    """Return the `_Neighbours` of interior columns, without limits."""
    count = params.distance.size
    index_offset, preference = np.empty(2 * count, dtype=np.int64), np.empty(2 * count)
    for k in range(count):
        back = 2 * count - 1 - k
        offset = params.offsets[k, 0] * params.cols + params.offsets[k, 1]
        index_offset[k] = index_offset[back] = offset
        preference[k] = preference[back] = _DISTANCE_PREFERENCE * params.distance[k]
    return _Neighbours(index_offset, preference, np.empty(2 * count))


@helper
def _set_limits(neighbours, params, tangent):  # type: ignore[no-untyped-def]
    """Set the limits of neighbours for the tangent of an angle of repose."""
    count = params.distance.size
    for k in range(count):
        limit = tangent * params.distance[k]
        neighbours.limit[k] = neighbours.limit[2 * count - 1 - k] = limit


@helper(inline="always")
def _layer_volume(columns, params, volume, soil):  # type: ignore[no-untyped-def]
    """Return the bank volume [mm^3] of the layer that runs down at once."""
    metres = columns.bulking_factor[soil] * columns.metres_per_mm3
    thin, thick = _MIN_LAYER * params.distance[0], _MAX_LAYER * params.distance[0]
    layer = min(max(volume / _LAYER_DIVISOR, thin / metres), thick / metres)
    return np.int64(layer) + 1


@helper(inline="always")
def _run_down(  # type: ignore[no-untyped-def]
    columns, params, occupied, queue, neighbours, shares, m, volume, steps, budget
):
    """Let a bank volume [mm^3] of share m run down from its column to where it stays.

    Returns:
        The number of steps, those before included.
    """
    i, soil, moisture = shares.cells[m], shares.soil[m], shares.moisture[m]
    bulking_factor, tangent = columns.bulking_factor[soil], params.repose_tan[soil, moisture]
    metres = bulking_factor * columns.metres_per_mm3
    has_noise = params.jitter != 0.0 or params.repose_tan_scale.size != 0
    while volume > 0:
        target, moving = np.int64(-1), np.int64(0)
        if steps < budget and occupied[i] == 0:
            top = columns.height[i] + volume * metres
            if not has_noise and _is_interior(params, i):
                target, excess = _find_interior_target(
                    columns.height, params, occupied, neighbours, i, top, steps % 2
                )
            else:
                target, excess = _find_target(
                    columns.height, params, occupied, i, top, tangent, steps % 2 == 0
                )
            if target >= 0:
                moving = min(np.int64(excess / metres), volume)
        staying = volume - moving
        if staying > 0:
            bulk = np.int64(staying * bulking_factor + 0.5)
            add_loose(columns, i, staying, bulk, soil, moisture)
            loose_tangent = params.repose_tan[columns.loose_soil[i], columns.loose_moisture[i]]
            if loose_tangent != tangent or steps >= budget:
                enqueue(queue, i)  # its angle of repose may be smaller than that of the share
        steps += 1
        i, volume = target, moving
    return steps


@helper(inline="always")
def _is_interior(params, i):  # type: ignore[no-untyped-def]
    """Return whether the whole neighbourhood of column i lies on the map."""
    row = i // params.cols
    col = i - row * params.cols
    return (
        params.reach <= row < params.rows - params.reach
        and params.reach <= col < params.cols - params.reach
    )


@helper(inline="always")
def _find_interior_target(height, params, occupied, neighbours, i, top, half):  # type: ignore[no-untyped-def]
    """Find the neighbour that soil up to `top` [m] on column i moves to.

    For a column whose neighbours all lie on the map, without noise; `half` selects the list.

    Returns:
        (flat index of the neighbour, -1 if there is none; largest excess over any neighbour [m]).
    """
    count = params.distance.size
    target = np.int64(-1)
    max_score = max_excess = 0.0
    for k in range(count * half, count * half + count):
        j = i + neighbours.index_offset[k]
        excess = top - height[j] - neighbours.limit[k]
        if excess > params.tolerance and occupied[j] == 0:
            max_excess = max(max_excess, excess)
            score = excess + neighbours.preference[k]
            if score > max_score:
                max_score, target = score, j
    return target, max_excess


@helper
def _find_target(height, params, occupied, i, top, tangent, forward):  # type: ignore[no-untyped-def]
    """Find the neighbour that soil up to `top` [m] on column i exceeds its slope against by most.

    For the edge of the map, and for noise.

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
            max_excess, target = excess, j
    return target, max_excess
