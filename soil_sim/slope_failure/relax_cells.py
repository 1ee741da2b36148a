"""Examining columns one by one: a kernel of `soil_sim.slope_failure`.

A ring holds the columns that wait. The first one gives soil to the neighbour it is too steep
against by most, again and again until it is steep against none; whoever got some, and whoever
stands too steep above what it left, is put into the ring in turn.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.state import add_loose, remove_loose, update_height
from soil_sim.slope_failure.relaxation_parameters import enqueue, uniform
from soil_sim.slope_failure.stability import enqueue_unstable_above, is_unstable

__all__ = ["MAX_LAYER_THICKNESS", "enqueue_steep_above", "mark_disturbed", "relax_cells"]

MAX_LAYER_THICKNESS = 0.25
"""Thickness of what moves at once, at most, in parts of a cell."""


@kernel
def mark_disturbed(columns, cells, include_neighbours, lowered, params, cell_queue):  # type: ignore[no-untyped-def]
    """Put columns into the ring, with `around` all their neighbours, with `sunk` what is too high
    above them and farther away."""
    offsets, far = params.offsets, params.stability.offsets.shape[0] > 0
    for i in cells:
        enqueue(i, cell_queue)
        if lowered and far:
            enqueue_unstable_above(columns, params, i, cell_queue)
        if include_neighbours:
            row, col = i // params.cols, i % params.cols
            for k in range(offsets.shape[0]):
                r, c = row + offsets[k, 0], col + offsets[k, 1]
                if 0 <= r < params.rows and 0 <= c < params.cols:
                    enqueue(r * params.cols + c, cell_queue)


@kernel
def relax_cells(columns, params, occupied, cell_queue, budget):  # type: ignore[no-untyped-def]
    """Examine columns that wait, with at most about `budget` looks around; returns how many."""
    firm, loose, height = columns.firm, columns.loose, columns.height
    offsets, distance, tolerance = params.offsets, params.distance, params.tolerance
    rows, cols, reach = params.rows, params.cols, params.reach
    metres_per_mm3, floor = columns.metres_per_mm3, columns.floor
    buffer, is_queued, head_tail = cell_queue.buffer, cell_queue.is_queued, cell_queue.head_tail
    count = offsets.shape[0]
    flat = np.empty(count, dtype=np.int64)
    for k in range(count):
        flat[k] = offsets[k, 0] * cols + offsets[k, 1]
    most_at_once = MAX_LAYER_THICKNESS * distance[0]
    looks = 0
    forward = True
    while head_tail[0] != head_tail[1] and looks < budget:
        i = buffer[head_tail[0]]
        head_tail[0] = (head_tail[0] + 1) % buffer.size
        is_queued[i] = 0
        looks += 1
        if occupied[i]:
            continue
        row, col = i // cols, i % cols
        interior = reach <= row < rows - reach and reach <= col < cols - reach
        if interior and not _may_fail(height, flat, distance, i, params.min_repose_tan, tolerance):
            continue
        gave = False
        coheres = params.stability.neighbour_height[columns.soil[i], columns.moisture[i], 0] > 0.0
        too_high = not coheres
        while True:
            kind, moisture = columns.soil[i], columns.moisture[i]
            firm_tangent = tangent = params.repose_tan[kind, moisture]
            if loose[i] > 0:
                tangent = params.repose_tan[columns.loose_soil[i], columns.loose_moisture[i]]
            if params.repose_tan_scale.size:
                tangent *= params.repose_tan_scale[i]
                firm_tangent *= params.repose_tan_scale[i]
            base = floor + firm[i] * metres_per_mm3
            gentle = min(tangent, firm_tangent)
            firm_excess = 0.0
            leans = False
            best, most, least = 0.0, 0.0, tolerance
            target = np.int64(-1)
            # Ties go to alternate ends of the list, or a heap would drift to one side.
            forward = not forward
            for n in range(count):
                k = n if forward else count - 1 - n
                if not interior:
                    r, c = row + offsets[k, 0], col + offsets[k, 1]
                    if r < 0 or r >= rows or c < 0 or c >= cols:
                        continue
                j = i + flat[k]
                drop = height[i] - height[j]
                if drop - gentle * distance[k] <= least or occupied[j] != 0:
                    continue
                # What can go: loose soil as far as there is any, and firm if it stands too high.
                excess = min(drop - tangent * distance[k], height[i] - base)
                fails = base - height[j] - firm_tangent * distance[k]
                leans |= fails > tolerance
                if fails > tolerance and too_high:
                    excess = max(drop - tangent * distance[k], fails) if loose[i] > 0 else fails
                else:
                    fails = 0.0
                if excess <= least:
                    continue
                if params.jitter > 0.0:
                    liking = excess * (1.0 + params.jitter * (2.0 * uniform(params.random) - 1.0))
                    if liking <= most:
                        continue
                    most = liking
                else:
                    least = excess
                best, firm_excess = excess, fails
                target = j
            looks += 1
            if leans and not too_high and is_unstable(columns, params, occupied, i):
                too_high = True  # look again the same way, at the firm soil, too
                forward = not forward
                continue
            if target < 0 or not _move_soil(columns, i, target, best, firm_excess, most_at_once):
                break
            gave = True
            too_high = not coheres
            enqueue(target, cell_queue)
        if gave:
            enqueue_steep_above(columns, params, i, cell_queue)
    return looks


@helper(forceinline=True)
def _may_fail(height, flat, distance, i, min_repose_tan, tolerance):  # type: ignore[no-untyped-def]
    """Whether a column is steeper against any neighbour than the min_repose_tan soil may be."""
    highest = height[i] - tolerance
    for k in range(flat.size):
        if highest - height[i + flat[k]] > min_repose_tan * distance[k]:
            return True
    return False


@helper
def enqueue_steep_above(columns, params, i, cell_queue):  # type: ignore[no-untyped-def]
    """Put those into the ring that stand too steep or too high above column i, which got lower."""
    height, loose, repose_tan = columns.height, columns.loose, params.repose_tan
    offsets, rows, cols = params.offsets, params.rows, params.cols
    row, col = i // cols, i % cols
    for k in range(offsets.shape[0]):
        r, c = row + offsets[k, 0], col + offsets[k, 1]
        if r < 0 or r >= rows or c < 0 or c >= cols:
            continue
        j = r * cols + c
        rise = height[j] - height[i] - params.tolerance
        # Most are not steeper than the min_repose_tan angle of any soil: their own needs no look.
        if rise > params.min_repose_tan * params.distance[k]:
            limit = repose_tan[columns.soil[j], columns.moisture[j]]
            if loose[j] > 0:
                upper = repose_tan[columns.loose_soil[j], columns.loose_moisture[j]]
                limit = min(upper, limit)
            limit *= params.distance[k]
            if params.repose_tan_scale.size:
                limit *= params.repose_tan_scale[j]
            if rise > limit:
                enqueue(j, cell_queue)
    if params.stability.offsets.shape[0] > 0:
        enqueue_unstable_above(columns, params, i, cell_queue)


@helper(inline="always")
def _move_soil(columns, i, j, excess, firm_excess, most_at_once):  # type: ignore[no-untyped-def]
    """Move half of an excess of height [m] from column i to j; returns whether anything went.

    Loose soil goes first and is loosened anew if it was packed; of firm soil goes half of what it
    has too much itself, and swells where it lands. No more than `most_at_once` [m] moves.
    """
    metres_per_mm3 = columns.metres_per_mm3
    went = False
    rest = min(excess, 2.0 * most_at_once)
    if columns.loose[i] > 0:
        kind = columns.loose_soil[i]
        bulking_factor = columns.bulking_factor[kind]
        packed = columns.bulk[i] / columns.loose[i]
        # i falls by packed, j rises by growth, for each mm^3 of bank volume.
        move = min(np.int64(rest / metres_per_mm3 / (packed + bulking_factor)), columns.loose[i])
        if move > 0:
            moisture = columns.loose_moisture[i]
            remove_loose(columns, i, move)
            add_loose(columns, j, move, np.int64(move * bulking_factor + 0.5), kind, moisture)
            rest -= move * (packed + bulking_factor) * metres_per_mm3
            went = True
    if firm_excess > 0.0 and columns.loose[i] == 0:
        kind = columns.soil[i]
        bulking_factor = columns.bulking_factor[kind]
        rest = min(rest, firm_excess)
        fail = min(np.int64(rest / metres_per_mm3 / (1.0 + bulking_factor)), columns.firm[i])
        if fail > 0:
            columns.firm[i] -= fail
            update_height(columns, i)
            bulk = np.int64(fail * bulking_factor + 0.5)
            add_loose(columns, j, fail, bulk, kind, columns.moisture[i])
            went = True
    return went
