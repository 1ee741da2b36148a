"""The surface of a window in float32, on which the passes of a large failure are planned."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.occupancy import FREE
from soil_sim.columns.operations import firm_top
from soil_sim.slope_failure.pair_blocks import BLOCK_SIZE

__all__ = ["WALL", "WindowSurface", "copy_surface", "padded_cols", "relaxed_cols"]

WALL = np.float32(np.nan)
"""Height of columns that neither give nor receive soil: comparisons with it are false."""

_SAME_TANGENT = 1.05
"""Ratio of the tangents of firm and loose soil up to which both slide together."""


class WindowSurface(NamedTuple):
    """Surface of a window of a map.

    The layers have shape (rows, cols) or, transposed, (cols, rows), so that rows are long: that is
    faster, and the directions in which soil slides are symmetric. Rows are padded by columns of a
    wall, see `padded_cols`.

    Attributes:
        heights: above its lowest point [m], float32; `WALL` where a tool is.
        floor: height below which soil does not move [m], float32: that of firm soil with cohesion,
            after `fail_wedges`, and of firm soil that stands steeper than the soil on it.
        tangents: tangent of the angle of repose at the surface, float32.
        num_cols: number of columns of the layers without those that pad them.
        tangent: that of the last column, float32; of all columns if `is_uniform`.
        is_uniform: whether the tangent is the same everywhere.
        is_bottomless: whether all soil of every column may move: no column can give more than it
            has, as none becomes lower than the one it gives to.
        is_transposed: whether the layers are transposed.
    """

    heights: NDArray[np.float32]
    floor: NDArray[np.float32]
    tangents: NDArray[np.float32]
    num_cols: int
    tangent: np.float32
    is_uniform: bool
    is_bottomless: bool
    is_transposed: bool


@kernel(forceinline=True)
def relaxed_cols(num_cols):  # type: ignore[no-untyped-def]
    """Return the number of columns of a row that are relaxed: whole blocks."""
    return -(-num_cols // BLOCK_SIZE) * BLOCK_SIZE


@kernel(forceinline=True)
def padded_cols(num_cols, reach):  # type: ignore[no-untyped-def]
    """Return the number of columns of a padded row, in which all have a partner `reach` away."""
    return relaxed_cols(num_cols) + reach


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
    if is_transposed:
        num_rows, num_cols = num_cols, num_rows
    shape = (num_rows, padded_cols(num_cols, params.reach))
    heights, floor = np.full(shape, WALL), np.zeros(shape, np.float32)
    tangents = np.zeros(shape, np.float32)
    flat_heights, flat_floor, flat_tangents = (
        heights.reshape(-1),
        floor.reshape(-1),
        tangents.reshape(-1),
    )
    lowest = _lowest_height(columns, params.cols, bounds)
    is_uniform, is_bottomless, last_tangent = True, True, -1.0
    limit = params.stability.neighbour_height
    row_step, col_step = (1, shape[1]) if is_transposed else (shape[1], 1)
    for row in range(bounds.first_row, bounds.end_row):
        for col in range(bounds.first_col, bounds.end_col):
            i = np.uint64(row * params.cols + col)
            if occupied[i] != FREE:
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
                is_bottomless = False
            if params.repose_tan_scale.size:
                tangent *= params.repose_tan_scale[i]
            k = np.uint64((row - bounds.first_row) * row_step + (col - bounds.first_col) * col_step)
            flat_heights[k] = columns.height[i] - lowest
            flat_floor[k] = fixed - lowest
            flat_tangents[k] = tangent
            is_uniform &= last_tangent in (-1.0, tangent)
            last_tangent = tangent
    return WindowSurface(
        heights, floor, tangents, num_cols, np.float32(last_tangent), is_uniform, is_bottomless,
        is_transposed,
    )  # fmt: skip


@helper(allocates=True)
def _lowest_height(columns, cols, bounds):  # type: ignore[no-untyped-def]
    """Return the height of the lowest column of a window [m]; the map has `cols` columns."""
    lowest = np.full(bounds.end_col - bounds.first_col, np.inf)
    for row in range(bounds.first_row, bounds.end_row):
        first = np.uint64(row * cols + bounds.first_col)
        for k in range(np.uint64(lowest.size)):  # column by column, for vector instructions
            lowest[k] = min(lowest[k], columns.height[first + k])
    return lowest.min()
