"""Relaxation of columns one by one.

A queue holds the columns to relax. The first one gives soil to the neighbour that it exceeds the
angle of repose against by most, until it exceeds it against none. The columns that received soil,
and those that are now too steep or too high above the column, are appended to the queue.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.operations import add_loose, remove_loose, update_height
from soil_sim.slope_failure.cell_queue import dequeue, enqueue, is_empty
from soil_sim.slope_failure.noise import random_uniform
from soil_sim.slope_failure.stability import enqueue_unstable_above, is_unstable

__all__ = ["enqueue_disturbed", "relax_cells"]

_MAX_LAYER_THICKNESS = 0.25
"""Maximum thickness of the layer that moves at once [cells]."""


@kernel
def enqueue_disturbed(columns, params, cells, include_neighbours, is_lowered, queue):  # type: ignore[no-untyped-def]
    """Enqueue columns that were disturbed.

    Args:
        columns: `ColumnArrays` of the terrain.
        params: `RelaxationParameters`.
        cells: flat indices of the columns.
        include_neighbours: whether to enqueue their neighbours, too.
        is_lowered: whether to enqueue distant columns that are now too high above them, too.
        queue: the `CellQueue`; changed.
    """
    offsets, has_cohesion = params.offsets, params.stability.distant_offsets.shape[0] > 0
    for i in cells:
        enqueue(queue, i)
        if is_lowered and has_cohesion:
            enqueue_unstable_above(columns, params, i, queue)
        if include_neighbours:
            row, col = i // params.cols, i % params.cols
            for k in range(offsets.shape[0]):
                r, c = row + offsets[k, 0], col + offsets[k, 1]
                if 0 <= r < params.rows and 0 <= c < params.cols:
                    enqueue(queue, r * params.cols + c)


# One long function on purpose: with the loops over neighbours in functions of their own, relaxation
# takes 12 to 18 % longer.
@kernel
def relax_cells(columns, params, occupied, queue, budget):  # type: ignore[no-untyped-def]
    """Relax columns of the queue until it is empty or about `budget` visits were made.

    Args:
        columns: `ColumnArrays` of the terrain; changed.
        params: `RelaxationParameters`.
        occupied: 1 for columns that neither give nor receive soil, flat, uint8.
        queue: the `CellQueue`; changed.
        budget: number of visits.

    Returns:
        The number of visits: searches of the neighbourhood of a column.
    """
    # The arrays are read from their tuples here: in the loops Numba would count references to them.
    firm, loose, height = columns.firm, columns.loose, columns.height
    offsets, distance, tolerance = params.offsets, params.distance, params.tolerance
    rows, cols, reach, count = params.rows, params.cols, params.reach, params.distance.size
    index_offset = _index_offsets(params)
    max_layer = _MAX_LAYER_THICKNESS * distance[0]
    visits = 0
    forward = True
    while not is_empty(queue) and visits < budget:
        i = dequeue(queue)
        visits += 1
        if occupied[i]:
            continue
        row, col = i // cols, i % cols
        is_interior = reach <= row < rows - reach and reach <= col < cols - reach
        if is_interior and not _may_fail(
            height, index_offset, distance, i, params.min_repose_tan, tolerance
        ):
            continue
        limit = params.stability.neighbour_height
        has_cohesion = limit[columns.soil[i], columns.moisture[i], 0] > 0.0
        has_moved, include_firm = False, not has_cohesion
        while True:
            firm_tangent = tangent = params.repose_tan[columns.soil[i], columns.moisture[i]]
            if loose[i] > 0:
                tangent = params.repose_tan[columns.loose_soil[i], columns.loose_moisture[i]]
            if params.repose_tan_scale.size:
                tangent *= params.repose_tan_scale[i]
                firm_tangent *= params.repose_tan_scale[i]
            firm_height = columns.floor + firm[i] * columns.metres_per_mm3
            min_tangent = min(tangent, firm_tangent)
            # Find the target: the neighbour with the largest excess, or with noise the largest
            # score. Ties go to alternate ends of the neighbourhood, or a heap would drift.
            target, target_excess, target_firm_excess = np.int64(-1), 0.0, 0.0
            max_score, min_excess = 0.0, tolerance
            is_firm_steep = False
            forward = not forward
            for n in range(count):
                k = n if forward else count - 1 - n
                if not is_interior:
                    r, c = row + offsets[k, 0], col + offsets[k, 1]
                    if r < 0 or r >= rows or c < 0 or c >= cols:
                        continue
                j = i + index_offset[k]
                drop = height[i] - height[j]
                if drop - min_tangent * distance[k] <= min_excess or occupied[j] != 0:
                    continue
                # Loose soil can move as far as there is any, and firm soil if it is unstable.
                excess = min(drop - tangent * distance[k], height[i] - firm_height)
                firm_excess = firm_height - height[j] - firm_tangent * distance[k]
                is_firm_steep |= firm_excess > tolerance
                if firm_excess > tolerance and include_firm:
                    surface_excess = drop - tangent * distance[k]
                    excess = max(surface_excess, firm_excess) if loose[i] > 0 else firm_excess
                else:
                    firm_excess = 0.0
                if excess <= min_excess:
                    continue
                if params.jitter > 0.0:
                    random = 2.0 * random_uniform(params.random_state) - 1.0
                    score = excess * (1.0 + params.jitter * random)
                    if score <= max_score:
                        continue
                    max_score = score
                else:
                    min_excess = excess
                target, target_excess, target_firm_excess = j, excess, firm_excess
            visits += 1
            if is_firm_steep and not include_firm and is_unstable(columns, params, occupied, i):
                include_firm = True  # search again in the same order, for the firm soil, too
                forward = not forward
                continue
            if target < 0 or not _move_soil(
                columns, i, target, target_excess, target_firm_excess, max_layer
            ):
                break
            has_moved, include_firm = True, not has_cohesion
            enqueue(queue, target)
        if has_moved:
            _enqueue_steep_above(columns, params, i, queue)
    return visits


@helper
def _index_offsets(params):  # type: ignore[no-untyped-def]
    """Return the offsets of the flat indices of the neighbours, shape (n,), int64."""
    index_offset = np.empty(params.distance.size, dtype=np.int64)
    for k in range(index_offset.size):
        index_offset[k] = params.offsets[k, 0] * params.cols + params.offsets[k, 1]
    return index_offset


@helper(forceinline=True)
def _may_fail(height, index_offset, distance, i, min_repose_tan, tolerance):  # type: ignore[no-untyped-def]
    """Return whether a column is steeper against any neighbour than the smallest angle of repose.

    For columns whose whole neighbourhood lies on the map.
    """
    highest = height[i] - tolerance
    for k in range(index_offset.size):
        if highest - height[i + index_offset[k]] > min_repose_tan * distance[k]:
            return True
    return False


@helper
def _enqueue_steep_above(columns, params, i, queue):  # type: ignore[no-untyped-def]
    """Enqueue the columns that are too steep or too high above column i, which was lowered."""
    row, col = i // params.cols, i % params.cols
    for k in range(params.offsets.shape[0]):
        r, c = row + params.offsets[k, 0], col + params.offsets[k, 1]
        if r < 0 or r >= params.rows or c < 0 or c >= params.cols:
            continue
        j = r * params.cols + c
        rise = columns.height[j] - columns.height[i] - params.tolerance
        # Most columns are below the smallest angle of repose of all soils: theirs need not be read.
        if rise > params.min_repose_tan * params.distance[k]:
            limit = params.repose_tan[columns.soil[j], columns.moisture[j]]
            if columns.loose[j] > 0:
                loose_tangent = params.repose_tan[columns.loose_soil[j], columns.loose_moisture[j]]
                limit = min(loose_tangent, limit)
            limit *= params.distance[k]
            if params.repose_tan_scale.size:
                limit *= params.repose_tan_scale[j]
            if rise > limit:
                enqueue(queue, j)
    if params.stability.distant_offsets.shape[0] > 0:
        enqueue_unstable_above(columns, params, i, queue)


@helper(inline="always")
def _move_soil(columns, i, j, excess, firm_excess, max_layer):  # type: ignore[no-untyped-def]
    """Move soil from column i to j so that half of an excess of height [m] is removed.

    Loose soil moves first, and is loosened again if it was compacted. Of firm soil, which swells
    where it is deposited, half of its own excess moves. The layer is at most `max_layer` [m] thick.

    Returns:
        Whether any soil moved.
    """
    metres_per_mm3 = columns.metres_per_mm3
    has_moved = False
    remaining = min(excess, 2.0 * max_layer)
    if columns.loose[i] > 0:
        kind = columns.loose_soil[i]
        bulking_factor = columns.bulking_factor[kind]
        bulk_ratio = columns.bulk[i] / columns.loose[i]
        # For each mm^3 of bank volume, i falls by the one and j rises by the other factor.
        volume = np.int64(remaining / metres_per_mm3 / (bulk_ratio + bulking_factor))
        volume = min(volume, columns.loose[i])
        if volume > 0:
            moisture = columns.loose_moisture[i]
            remove_loose(columns, i, volume)
            add_loose(columns, j, volume, np.int64(volume * bulking_factor + 0.5), kind, moisture)
            remaining -= volume * (bulk_ratio + bulking_factor) * metres_per_mm3
            has_moved = True
    if firm_excess > 0.0 and columns.loose[i] == 0:
        kind = columns.soil[i]
        bulking_factor = columns.bulking_factor[kind]
        remaining = min(remaining, firm_excess)
        volume = np.int64(remaining / metres_per_mm3 / (1.0 + bulking_factor))
        volume = min(volume, columns.firm[i])
        if volume > 0:
            columns.firm[i] -= volume
            update_height(columns, i)
            bulk = np.int64(volume * bulking_factor + 0.5)
            add_loose(columns, j, volume, bulk, kind, columns.moisture[i])
            has_moved = True
    return has_moved
