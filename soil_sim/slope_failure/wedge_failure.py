"""Failure of a face that stands higher than its cohesion supports: a wedge comes loose.

The face fails along the plane of Culmann's method, through its toe at the angle

    theta = (beta + phi) / 2

(beta: slope of the face, phi: internal friction), which has the least reserve of strength; see
`soil_sim.slope_failure.stability`. All firm soil above the plane becomes loose where it stands,
from the toe to where the plane reaches the surface behind the crest. It keeps its volume until it
slides, so that no surface rises. It slides as loose soil does, in as many ticks as the budget of
relaxation needs, swells, and comes to rest as a fan at its angle of repose.

A wedge is loosened up the face, beginning at the column that was found to be unstable. Each column
of a crest has a wedge of its own, so that a wall fails along its whole length. The wedges spread a
little to the sides, because around a corner the directions up the face diverge.
"""

from __future__ import annotations

import math

import numpy as np

from msg_bridge.kernels import helper
from soil_sim.columns.occupancy import TOOL_INSIDE
from soil_sim.columns.operations import add_loose, firm_top, remove_firm
from soil_sim.slope_failure.cell_queue import enqueue
from soil_sim.slope_failure.stability import face_length, find_toe

__all__ = ["fail_wedge", "fail_wedges"]

_SPREAD = 0.4
"""Increase of half the width of a wedge with the distance behind the crest: that of the wedges of
two columns beside each other whose directions differ by less than 44 degrees."""


@helper
def fail_wedges(columns, params, occupied, queue, bounds):  # type: ignore[no-untyped-def]
    """Loosen the wedges of all unstable faces of a window.

    Args:
        columns, params, occupied, queue: see `SlopeArrays`; the columns and the queue are changed.
        bounds: `WindowBounds`.
    """
    limit = params.stability.neighbour_height
    if not params.stability.has_cohesion:
        return
    for row in range(bounds.first_row, bounds.end_row):
        for col in range(bounds.first_col, bounds.end_col):
            i = row * params.cols + col
            u = np.uint64(i)  # faster, see `msg_bridge.kernels.decorators`
            has_cohesion = limit[columns.soil[u], columns.moisture[u], 0] > 0.0
            if has_cohesion and occupied[i] != TOOL_INSIDE and _is_steep(columns, params, i):
                fail_wedge(columns, params, occupied, i, queue)


@helper
def fail_wedge(columns, params, occupied, i, queue):  # type: ignore[no-untyped-def]
    """Loosen the wedge above the failure plane of a face, if it is unstable.

    Args:
        columns, params, occupied, queue: see `SlopeArrays`; loosened columns are enqueued.
        i: flat index of a column with cohesive soil, steeper than its angle of repose.

    Returns:
        Whether the face was unstable: firm soil of the column is loose now.
    """
    toe, stable_height = find_toe(columns, params, occupied, i)
    top = firm_top(columns, i)
    if toe < 0 or top - stable_height <= params.tolerance:
        return False
    cell, toe_height = params.distance[0], columns.height[toe]
    row, col = i // params.cols, i % params.cols
    rows, cols = row - toe // params.cols, col - toe % params.cols
    up_row, up_col = _direction_up(columns, params, i, rows, cols, toe_height)
    run = rows * up_row + cols * up_col  # from the toe [cells]
    slope = math.atan2(top - toe_height, face_length(run) * cell)
    rise = cell * math.tan(0.5 * (slope + params.stability.friction[columns.soil[i]]))
    # At least down to where the column is stable.
    plane = min(toe_height + (run - 0.5) * rise, stable_height)
    _loosen_above(columns, occupied, i, plane, columns.soil[i], queue)
    kind, longer = columns.soil[i], max(abs(up_row), abs(up_col))
    for way in (-1, 1):  # down to the toe, then up to where the plane reaches the surface
        step = 0
        while True:
            step += way
            run_at_step = run + step / longer
            if run_at_step < 0.5:
                break
            is_loosened = False
            width = 1 + int(_SPREAD * max(step, 0))
            # Two columns at each point: along a diagonal, steps of one column pass every other one.
            for n in range(2 * (2 * width + 1)):
                aside, beside = n // 2 - width, n % 2
                r = row + round((step * up_row - aside * up_col) / longer) + beside
                c = col + round((step * up_col + aside * up_row) / longer)
                along = run + (r - row) * up_row + (c - col) * up_col
                if along < 0.5 or not (0 <= r < params.rows and 0 <= c < params.cols):
                    continue
                k = r * params.cols + c
                is_loosened |= _loosen_above(
                    columns, occupied, k, toe_height + (along - 0.5) * rise, kind, queue
                )
            if way > 0 and not is_loosened:
                break
    return True


@helper
def _loosen_above(columns, occupied, i, plane, kind, queue):  # type: ignore[no-untyped-def]
    """Make the firm soil of column i above a height loose, without swell, and enqueue the column.

    Returns:
        Whether there is any, of a kind and without a tool in it.
    """
    height = firm_top(columns, i) - plane
    if columns.soil[i] != kind or occupied[i] == TOOL_INSIDE or height <= 0.0:
        return False
    volume = remove_firm(columns, i, np.int64(height / columns.metres_per_mm3) + 1)
    add_loose(columns, i, volume, volume, kind, columns.moisture[i])
    enqueue(queue, i)
    return True


@helper
def _direction_up(columns, params, i, rows, cols, toe_height):  # type: ignore[no-untyped-def]
    """Return the direction up a face at column i, a unit vector (row, col).

    From the columns around it that are lower than half the height of the face: the toe alone is
    beside a wall in one of few directions. From the toe if that is not among them.

    Args:
        columns, params: see `SlopeArrays`.
        i: flat index of the column.
        rows, cols: from the toe to the column [cells].
        toe_height: height of the toe [m].
    """
    if max(abs(rows), abs(cols)) <= params.reach:
        middle = 0.5 * (columns.height[i] + toe_height)
        row, col = i // params.cols, i % params.cols
        up_row = up_col = 0
        for k in range(params.offsets.shape[0]):
            # Beyond the edge of the map the face continues.
            r = min(max(row + params.offsets[k, 0], 0), params.rows - 1)
            c = min(max(col + params.offsets[k, 1], 0), params.cols - 1)
            if columns.height[r * params.cols + c] < middle:
                up_row -= params.offsets[k, 0]
                up_col -= params.offsets[k, 1]
        if up_row * rows + up_col * cols > 0:
            rows, cols = up_row, up_col
    length = math.hypot(rows, cols)
    return rows / length, cols / length


@helper
def _is_steep(columns, params, i):  # type: ignore[no-untyped-def]
    """Return whether firm soil of column i is steeper than its angle of repose to a neighbour."""
    tangent = params.repose_tan[columns.soil[i], columns.moisture[i]]
    if params.repose_tan_scale.size:
        tangent *= params.repose_tan_scale[i]
    height = firm_top(columns, i) - params.tolerance
    row, col = i // params.cols, i % params.cols
    for k in range(params.offsets.shape[0]):
        r, c = row + params.offsets[k, 0], col + params.offsets[k, 1]
        if not (0 <= r < params.rows and 0 <= c < params.cols):
            continue
        if height - columns.height[r * params.cols + c] > tangent * params.distance[k]:
            return True
    return False
