"""Pouring: soil that comes onto a slope runs down it and stays where it can (reference, 3.1.2).

What a column gets too much goes on, whole, to the neighbour it is too steep against by most, or by
as much but for a little and is farther, from there to the next, and what a column can keep stays on
it. Only what came moves: no column ends lower than it was, so none above it has cause to slip, and
nothing is looked at twice. That is much less work than to examine all who gave or got some
(`soil_sim.slope_failure.relax_cells`), and as good as long as a thin layer runs down at a time.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.state import add_loose
from soil_sim.slope_failure.relaxation_parameters import enqueue, uniform

__all__ = ["deposit_with_runout"]

_MIN_LAYER, _MAX_LAYER = 0.05, 0.5
"""Least and largest thickness of what runs down at once, in parts of a cell: thicker is quicker,
and leaves the slope less even and less steep by half of it."""

_LAYER_DIVISOR = 24
"""In between, this part of what is still to come runs down at once, so that the last is thin."""


_ROLL_ON_FRACTION = 0.3
"""Part of the slope by which soil may roll on by chance where it could stay, at `uneven` 1."""

_DISTANCE_PREFERENCE = 0.01
"""Of neighbours that it is about as much too steep against soil takes the farther: by this much of
the distance. On a slope that is as steep as can be all are alike. Not at the map's edge, nor where
columns differ."""


@kernel
def deposit_with_runout(  # type: ignore[no-untyped-def]
    columns, params, occupied, cell_queue, cells, volume, soil, moisture, first_index, budget
):
    """Put loose soil onto columns, in at most about `budget` steps down; returns how many it took.

    `volume` [mm^3 bank] of `soil` with `moisture` comes to each of `cells`, shape (n,) each; of
    the same soil to the same column at once. `first_of` is scratch, zeros of the map's size, and
    `volume` is used up. Where the budget is spent soil stays where it came down, and is put into
    the ring.
    """
    _merge_duplicates(cells, volume, soil, moisture, first_index)
    rows, cols, reach, metres_per_mm3 = (
        params.rows,
        params.cols,
        params.reach,
        columns.metres_per_mm3,
    )
    height, repose_tan, repose_tan_scale = (
        columns.height,
        params.repose_tan,
        params.repose_tan_scale,
    )
    count = params.distance.size
    # Ties go to alternate ends of the list, or a heap would drift to one side: it is here twice.
    flat, limit = np.empty(2 * count, dtype=np.int64), np.empty(2 * count)
    far = np.empty(2 * count)
    for k in range(count):
        back = 2 * count - 1 - k
        flat[k] = flat[back] = params.offsets[k, 0] * cols + params.offsets[k, 1]
        far[k] = far[back] = _DISTANCE_PREFERENCE * params.distance[k]
    even = params.jitter == 0.0 and repose_tan_scale.size == 0
    limit_of = np.nan
    thin, thick = _MIN_LAYER * params.distance[0], _MAX_LAYER * params.distance[0]
    steps = 0
    waiting, left = np.empty(volume.size, dtype=np.int64), 0
    for m in range(volume.size):
        first_index[cells[m]] = 0
        if volume[m] != 0:
            waiting[left] = m
            left += 1
    while left:
        # In turns, so that what comes to many columns at once rises everywhere at once.
        for n in range(left):
            m = waiting[n]
            i, bulking_factor, tangent = (
                cells[m],
                columns.bulking_factor[soil[m]],
                repose_tan[soil[m], moisture[m]],
            )
            if tangent != limit_of:
                for k in range(count):
                    limit[k] = limit[2 * count - 1 - k] = tangent * params.distance[k]
                limit_of = tangent
            metres = bulking_factor * metres_per_mm3
            moving = volume[m]
            if steps < budget:
                layer = min(max(moving / _LAYER_DIVISOR, thin / metres), thick / metres)
                moving = min(np.int64(layer) + 1, moving)
            volume[m] -= moving
            while moving > 0:
                target, onward = np.int64(-1), np.int64(0)
                if steps < budget and occupied[i] == 0:
                    top = height[i] + moving * metres
                    row = i // cols
                    col = i - row * cols
                    inside = reach <= row < rows - reach and reach <= col < cols - reach
                    first = count * (steps % 2)
                    if even and inside:
                        liked = most = 0.0
                        for k in range(first, first + count):
                            j = i + flat[k]
                            over = top - height[j] - limit[k]
                            if over > params.tolerance and occupied[j] == 0:
                                most = max(most, over)
                                liking = over + far[k]
                                if liking > liked:
                                    liked, target = liking, j
                    else:
                        target, most = _choose_target(
                            height, params, occupied, i, top, tangent, steps % 2 == 0
                        )
                    if target >= 0:
                        onward = min(np.int64(most / metres), moving)
                stays = moving - onward
                if stays > 0:
                    bulk = np.int64(stays * bulking_factor + 0.5)
                    add_loose(columns, i, stays, bulk, soil[m], moisture[m])
                    now = repose_tan[columns.loose_soil[i], columns.loose_moisture[i]]
                    if now != tangent or steps >= budget:
                        enqueue(i, cell_queue)  # it may be less steep than what came
                steps += 1
                i, moving = target, onward
        turn, left = left, 0
        for n in range(turn):
            if volume[waiting[n]] > 0:
                waiting[left] = waiting[n]
                left += 1
    return steps


@helper
def _merge_duplicates(cells, volume, soil, moisture, first_index):  # type: ignore[no-untyped-def]
    """Let what comes to one column of one soil come at once."""
    for m in range(cells.size):
        first = first_index[cells[m]] - 1
        if first < 0:
            first_index[cells[m]] = m + 1
        elif soil[first] == soil[m] and moisture[first] == moisture[m]:
            volume[first] += volume[m]
            volume[m] = 0


@helper
def _choose_target(height, params, occupied, i, top, tangent, forward):  # type: ignore[no-untyped-def]
    """(neighbour, excess [m]) that soil up to `top` is too steep against by most; -1 if none.

    For the map's edge, and where columns differ or soil rolls on by chance.
    """
    if params.repose_tan_scale.size:
        tangent *= params.repose_tan_scale[i]
    if params.jitter > 0.0:
        tangent *= 1.0 - _ROLL_ON_FRACTION * params.jitter * uniform(params.random)
    row, col = i // params.cols, i % params.cols
    target = np.int64(-1)
    most = params.tolerance
    count = params.distance.size
    for n in range(count):
        k = n if forward else count - 1 - n
        r, c = row + params.offsets[k, 0], col + params.offsets[k, 1]
        if r < 0 or r >= params.rows or c < 0 or c >= params.cols:
            continue
        j = r * params.cols + c
        over = top - height[j] - tangent * params.distance[k]
        if over > most and occupied[j] == 0:
            most, target = over, j
    return target, most
