"""The surface of a window in float32, on which the passes of a large failure are planned."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import kernel
from soil_sim.columns.occupancy import FREE
from soil_sim.columns.operations import firm_top
from soil_sim.columns.state import Columns
from soil_sim.slope_failure.relaxation_parameters import RelaxationParameters
from soil_sim.slope_failure.window import WindowBounds

__all__ = ["WindowSurface", "copy_surface"]

_WALL_HEIGHT = np.float32(1e6)
"""Height of columns that neither give nor receive soil [m]."""

_SAME_TANGENT = 1.05
"""Ratio of the tangents of firm and loose soil up to which both slide together."""

Layer = NDArray[np.float32]


class WindowSurface(NamedTuple):
    """Surface of a window of a map.

    The layers have shape (rows, cols) or, transposed, (cols, rows), so that rows are long: that is
    faster, and the directions in which soil slides are symmetric.

    Attributes:
        heights: above its lowest point [m].
        floor: height below which soil does not move [m]: that of firm soil with cohesion, after
            `fail_wedges`, and of firm soil that stands steeper than the soil on it.
        tangents: tangent of the angle of repose at the surface.
        is_uniform: whether the tangent is the same everywhere.
        is_transposed: whether the layers are transposed.
    """

    heights: Layer
    floor: Layer
    tangents: Layer
    is_uniform: bool
    is_transposed: bool

    @property
    def is_wall(self) -> NDArray[np.bool_]:
        """Columns that neither give nor receive soil, as the layers."""
        return self.heights >= _WALL_HEIGHT

    def changes_of(self, heights: Layer) -> NDArray[np.float64]:
        """Return the changes to present heights [m], shape (rows, cols)."""
        change = (heights - self.heights).astype(np.float64)
        return np.ascontiguousarray(change.T) if self.is_transposed else change


def copy_surface(
    columns: Columns,
    params: RelaxationParameters,
    occupied: NDArray[np.uint8],
    bounds: WindowBounds,
) -> WindowSurface:
    """Return the surface of a window.

    Args:
        columns: the terrain.
        params: angles of repose and stability of firm soil.
        occupied: marks of `columns.occupancy`, shape (rows, cols).
        bounds: the window.
    """
    lowest = float(columns.height[bounds.slices].min())
    rows, cols = bounds.shape
    is_transposed = rows > cols
    shape = (cols, rows) if is_transposed else (rows, cols)
    heights, floor, tangents = (np.empty(shape, dtype=np.float32) for _ in range(3))
    is_uniform = _copy_surface(
        columns.arrays,
        params,
        occupied.reshape(-1),
        bounds,
        lowest,
        is_transposed,
        (heights, floor, tangents),
    )
    return WindowSurface(heights, floor, tangents, bool(is_uniform), is_transposed)


@kernel
def _copy_surface(  # type: ignore[no-untyped-def]
    columns, params, occupied, bounds, lowest, is_transposed, surface
):
    """Write the surface of a window; see `WindowSurface`.

    Args:
        columns: `ColumnArrays` of the terrain.
        params: `RelaxationParameters`.
        occupied: marks of `columns.occupancy`, flat.
        bounds: the window.
        lowest: height of its lowest point [m].
        is_transposed: whether the layers are transposed.
        surface: heights, floor and tangents.

    Returns:
        Whether the tangent is the same everywhere.
    """
    heights, floor, tangents = surface
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
                heights[r, c] = floor[r, c] = _WALL_HEIGHT
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
    return is_uniform
