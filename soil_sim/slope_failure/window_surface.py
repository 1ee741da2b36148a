"""The surface of a window in float32, on which the passes of a large failure are planned."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper
from soil_sim.columns.occupancy import FREE
from soil_sim.columns.operations import firm_top

__all__ = ["WALL_HEIGHT", "WindowSurface", "copy_surface"]

WALL_HEIGHT = np.float32(1e6)
"""Height of columns that neither give nor receive soil [m]."""

_SAME_TANGENT = 1.05
"""Ratio of the tangents of firm and loose soil up to which both slide together."""


class WindowSurface(NamedTuple):
    """Surface of a window of a map.

    The layers have shape (rows, cols) or, transposed, (cols, rows), so that rows are long: that is
    faster, and the directions in which soil slides are symmetric.

    Attributes:
        heights: above its lowest point [m], float32; `WALL_HEIGHT` where a tool is.
        floor: height below which soil does not move [m], float32: that of firm soil with cohesion,
            after `fail_wedges`, and of firm soil that stands steeper than the soil on it.
        tangents: tangent of the angle of repose at the surface, float32.
        is_uniform: whether the tangent is the same everywhere.
        is_transposed: whether the layers are transposed.
    """

    heights: NDArray[np.float32]
    floor: NDArray[np.float32]
    tangents: NDArray[np.float32]
    is_uniform: bool
    is_transposed: bool


@helper(allocates=True)
def copy_surface(columns, params, occupied, bounds):  # type: ignore[no-untyped-def]
    """Return the `WindowSurface` of a window.

    Args:
        columns: `ColumnArrays` of the terrain.
        params: `RelaxationParameters`.
        occupied: marks of `columns.occupancy`, flat.
        bounds: `WindowBounds`.
    """
    num_rows, num_cols = bounds.end_row - bounds.first_row, bounds.end_col - bounds.first_col
    is_transposed = num_rows > num_cols
    shape = (num_cols, num_rows) if is_transposed else (num_rows, num_cols)
    heights, floor = np.empty(shape, np.float32), np.empty(shape, np.float32)
    tangents = np.empty(shape, np.float32)
    lowest = np.inf
    for row in range(bounds.first_row, bounds.end_row):
        for col in range(bounds.first_col, bounds.end_col):
            lowest = min(lowest, columns.height[row * params.cols + col])
    is_uniform, last_tangent = True, -1.0
    limit = params.stability.neighbour_height
    for row in range(bounds.first_row, bounds.end_row):
        for col in range(bounds.first_col, bounds.end_col):
            i = row * params.cols + col
            r, c = row - bounds.first_row, col - bounds.first_col
            if is_transposed:
                r, c = c, r
            if occupied[i] != FREE:
                # A wall: too high to receive soil, and without soil to give.
                heights[r, c] = floor[r, c] = WALL_HEIGHT
                tangents[r, c] = np.float32(0.0)
                continue
            kind, moisture = columns.soil[i], columns.moisture[i]
            tangent = firm_tangent = params.repose_tan[kind, moisture]
            if columns.loose[i] > 0:
                tangent = params.repose_tan[columns.loose_soil[i], columns.loose_moisture[i]]
            # Firm soil that stands steeper than the soil on it fails in a later call, when it is
            # bare.
            fixed = columns.floor
            if limit[kind, moisture, 0] > 0.0 or firm_tangent > _SAME_TANGENT * tangent:
                fixed = firm_top(columns, i)
            if params.repose_tan_scale.size:
                tangent *= params.repose_tan_scale[i]
            heights[r, c] = columns.height[i] - lowest
            floor[r, c] = fixed - lowest
            tangents[r, c] = tangent
            is_uniform &= last_tangent in (-1.0, tangent)
            last_tangent = tangent
    return WindowSurface(heights, floor, tangents, is_uniform, is_transposed)
