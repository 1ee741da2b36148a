"""Relaxation of columns one by one.

A queue holds the columns to relax. The first one gives soil to the neighbour that it exceeds the
angle of repose against by most, until it exceeds it against none. The columns that received soil,
and those that are now too steep or too high above the column, are appended to the queue.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.occupancy import TOOL_INSIDE
from soil_sim.columns.operations import add_loose, firm_top, remove_firm, remove_loose
from soil_sim.slope_failure.cell_queue import dequeue, enqueue, is_empty
from soil_sim.slope_failure.neighbourhood import is_tool_between
from soil_sim.slope_failure.noise import random_uniform
from soil_sim.slope_failure.stability import enqueue_unstable_above
from soil_sim.slope_failure.wedge_failure import fail_wedge

__all__ = ["enqueue_disturbed", "relax_cells"]

_MAX_LAYER_THICKNESS = 0.25
"""Maximum thickness of the layer that moves at once [cells]."""


class _SlopeLimits(NamedTuple):
    """Limits of the slope of a column.

    Attributes:
        tangent, firm_tangent: tangents of the angles of repose of its top and its firm soil.
        firm_height: height of its firm soil [m].
        has_loose: whether there is loose soil on it.
        include_firm: whether its firm soil may move.
    """

    tangent: float
    firm_tangent: float
    firm_height: float
    has_loose: bool
    include_firm: bool


@kernel
def enqueue_disturbed(slopes, cells, include_neighbours, is_lowered):  # type: ignore[no-untyped-def]
    """Enqueue columns that were disturbed.

    Args:
        slopes: `SlopeArrays`, boxed; the queue is changed.
        cells: flat indices of the columns.
        include_neighbours: whether to enqueue their neighbours, too.
        is_lowered: whether to enqueue distant columns that are now too high above them, too.
    """
    columns, params, _, queue = slopes.table
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


@kernel
def relax_cells(slopes, budget):  # type: ignore[no-untyped-def]
    """Relax columns of the queue until it is empty or about `budget` visits were made.

    1. Take the first column of the queue. Skip it if a tool is in it, or if it is steeper against
       no neighbour than the smallest angle of repose of all soils.
    2. Find the neighbour that it exceeds the angle of repose against by most. Firm soil counts if
       it has no cohesion.
    3. If firm soil did not count but is too steep, test the stability of its face. If it is
       unstable, its wedge comes loose (`soil_sim.slope_failure.wedge_failure`): repeat step 2.
    4. Move soil to the neighbour, enqueue it, and continue with step 2.
    5. If there is no such neighbour, or less than 1 mm^3 to move, the column is at rest. If it gave
       soil, enqueue the columns that are now too steep or too high above it.

    Args:
        slopes: `SlopeArrays`, boxed; the columns and the queue are changed.
        budget: number of visits.

    Returns:
        The number of visits: searches of the neighbourhood of a column.
    """
    # The arrays are read from their tuples here: in the loops Numba would count references to them.
    columns, params, occupied, queue = slopes.table
    loose, height = columns.loose, columns.height
    offsets, between, distance = params.offsets, params.between, params.distance
    tolerance = params.tolerance
    rows, cols, reach = params.rows, params.cols, params.reach
    index_offset, random_state = _index_offsets(params), params.random_state
    max_layer = _MAX_LAYER_THICKNESS * distance[0]
    steep = np.empty(distance.size, np.int64)
    visits = 0
    forward = False
    while not is_empty(queue) and visits < budget:
        i = dequeue(queue)
        visits += 1
        if occupied[i] == TOOL_INSIDE:
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
        num_steep = np.int64(-1)  # not listed yet
        while True:
            # Not in a function: if it takes the tuples, relaxation takes up to 30 % longer.
            firm_tangent = tangent = params.repose_tan[columns.soil[i], columns.moisture[i]]
            if loose[i] > 0:
                tangent = params.repose_tan[columns.loose_soil[i], columns.loose_moisture[i]]
            if params.repose_tan_scale.size:
                tangent *= params.repose_tan_scale[i]
                firm_tangent *= params.repose_tan_scale[i]
            top = firm_top(columns, i)
            slope = _SlopeLimits(tangent, firm_tangent, top, loose[i] > 0, include_firm)
            if num_steep < 0:
                num_steep = _list_steep_neighbours(
                    height, offsets, index_offset, distance, (rows, cols), i, is_interior, slope,
                    tolerance, steep,
                )  # fmt: skip
            target, excess, firm_excess, is_firm_steep = _find_target(
                height, occupied, index_offset, between, distance, i, steep, num_steep, slope,
                forward, tolerance, params.jitter, random_state,
            )  # fmt: skip
            visits += 1
            if is_firm_steep and has_cohesion and fail_wedge(columns, params, occupied, i, queue):
                num_steep = np.int64(-1)
                continue
            forward = not forward
            if target < 0 or not _move_soil(columns, i, target, excess, firm_excess, max_layer):
                break
            has_moved = True
            enqueue(queue, target)
        if has_moved:
            _enqueue_steep_above(columns, params, i, queue)
    return visits


@helper(forceinline=True)
def _find_target(  # type: ignore[no-untyped-def]
    height, occupied, index_offset, between, distance, i, steep, num_steep, slope, forward,
    tolerance, jitter, random_state,
):  # fmt: skip
    """Find the neighbour that a column exceeds the angle of repose against by most.

    With noise, the excess is multiplied by a random factor. Ties go to alternate ends of the
    neighbourhood, or a heap would drift.

    Args:
        height: surface of each column [m], flat.
        occupied: marks of `columns.occupancy`, flat, uint8.
        index_offset, distance: offset of the flat index and distance [m] of the neighbours.
        between: see `RelaxationParameters`.
        i: flat index of the column.
        steep, num_steep: neighbours to compare, see `_list_steep_neighbours`.
        slope: its `_SlopeLimits`.
        forward: whether the neighbours are compared from the first to the last.
        tolerance: excess that does not count [m].
        jitter: amplitude of the random factor; 0 for none.
        random_state: state of the random numbers; changed.

    Returns:
        (flat index of the neighbour, -1 if there is none; excess over it [m]; excess of the firm
        soil [m], 0 if it may not move; whether firm soil is too steep against any neighbour).
    """
    tangent, firm_tangent, firm_height, has_loose, include_firm = slope
    height_of_i, min_tangent = height[i], min(tangent, firm_tangent)
    target, target_excess, target_firm_excess = np.int64(-1), 0.0, 0.0
    max_score, min_excess = 0.0, tolerance
    is_firm_steep = False
    for n in range(num_steep):
        k = np.uint64(steep[np.uint64(n if forward else num_steep - 1 - n)])
        j = np.uint64(i + index_offset[k])
        drop = height_of_i - height[j]
        if drop - min_tangent * distance[k] <= min_excess or occupied[j] != 0:
            continue
        if is_tool_between(occupied, between, i, k):
            continue
        # Loose soil can move as far as there is any, and firm soil if it is unstable.
        excess = min(drop - tangent * distance[k], height_of_i - firm_height)
        firm_excess = firm_height - height[j] - firm_tangent * distance[k]
        is_firm_steep |= firm_excess > tolerance
        if firm_excess > tolerance and include_firm:
            surface_excess = drop - tangent * distance[k]
            excess = max(surface_excess, firm_excess) if has_loose else firm_excess
        else:
            firm_excess = 0.0
        if excess <= min_excess:
            continue
        if jitter > 0.0:
            random = 2.0 * random_uniform(random_state) - 1.0
            score = excess * (1.0 + jitter * random)
            if score <= max_score:
                continue
            max_score = score
        else:
            min_excess = excess
        target, target_excess, target_firm_excess = np.int64(j), excess, firm_excess
    return target, target_excess, target_firm_excess, is_firm_steep


@helper(forceinline=True)
def _list_steep_neighbours(  # type: ignore[no-untyped-def]
    height, offsets, index_offset, distance, shape, i, is_interior, slope, tolerance, steep
):
    """List the neighbours of a column that it may give soil to, in their order.

    While it gives soil to some of them, none is added: it becomes lower, they higher, and its
    loose soil, which may have the smaller angle, can only be used up.

    Args:
        height: surface of each column [m], flat.
        offsets, index_offset, distance: rows and columns, offset of the flat index and distance [m]
            of the neighbours.
        shape: number of rows and of columns.
        i: flat index of the column.
        is_interior: whether all its neighbours lie on the map.
        slope: its `_SlopeLimits`.
        tolerance: excess that does not count [m].
        steep: out, numbers of the neighbours.

    Returns:
        The number of neighbours listed.
    """
    row, col = i // shape[1], i % shape[1]
    min_tangent = min(slope.tangent, slope.firm_tangent)
    count = np.int64(0)
    for k in range(distance.size):
        if not is_interior:
            r, c = row + offsets[k, 0], col + offsets[k, 1]
            if r < 0 or r >= shape[0] or c < 0 or c >= shape[1]:
                continue
        drop = height[i] - height[np.uint64(i + index_offset[k])]
        steep[np.uint64(count)] = k  # without a branch: overwritten unless it counts
        count += drop - min_tangent * distance[k] > tolerance
    return count


@helper(allocates=True)
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
        if highest - height[np.uint64(i + index_offset[k])] > min_repose_tan * distance[k]:
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


@helper(forceinline=True)
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
        if volume > 0:
            volume = remove_firm(columns, i, volume)
            bulk = np.int64(volume * bulking_factor + 0.5)
            add_loose(columns, j, volume, bulk, kind, columns.moisture[i])
            has_moved = True
    return has_moved
