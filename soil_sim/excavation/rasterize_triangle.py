"""Rasterization of triangles: lower the subcolumns whose sample points lie below a triangle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper
from soil_sim.excavation.refined_columns import (
    MOMENT_X,
    MOMENT_Y,
    MOMENT_Z,
    REMOVED_HEIGHT,
    RefinedArrays,
)

__all__ = ["Raster", "SubcolumnGrid", "enter_column", "rasterize_quad"]

_SAMPLE_OFFSET_U, _SAMPLE_OFFSET_V = 1e-3, 1.7e-3
"""Offset of the sample points from the centres of the subcolumns [subcolumns]. An edge along a row
of centres, common with maps and tools of round dimensions, would otherwise count half a subcolumn
too much or, by rounding, too little. Two different offsets, so that the same holds for edges at
45 degrees."""

_SPAN_TOLERANCE = 1e-9
"""Extension of the rows of a triangle [subcolumns]: adjacent triangles leave no gap by rounding."""

_MIN_AREA, _MAX_AREA = 1e-9, 1e18
"""Limits of twice the area of a triangle, seen from above [subcolumns^2]."""


class SubcolumnGrid(NamedTuple):
    """Grid of subcolumns, for kernels.

    Attributes:
        rows, cols, cell, x_first, y_first: as in `GridFrame`.
        subcolumns_per_side: number of subcolumns along a side of a column.
    """

    rows: int
    cols: int
    cell: float
    x_first: float
    y_first: float
    subcolumns_per_side: int


class Raster(NamedTuple):
    """The arrays that a sweep is rasterized to.

    Attributes:
        height: surface of each column of the map [m], flat.
        floor: height of the undiggable floor [m].
        refined: refined columns; changed.
        grid: the grid of subcolumns.
        tick: number of the tick.
    """

    height: NDArray[np.float64]
    floor: float
    refined: RefinedArrays
    grid: SubcolumnGrid
    tick: int


@helper(inline="always")
def enter_column(k, z, height, refined, tick):  # type: ignore[no-untyped-def]
    """Return the slot of column k for a tool at height z [m], -1 if the tool is above it.

    A column that the tool enters is refined, and one that it is in is marked as occupied.
    """
    slot = refined.slot_of[k]
    if slot < 0 and z < height[k]:
        slot = _refine_column(k, height, refined)
    if slot >= 0 and z <= refined.initial_height[slot]:
        refined.last_tick[slot] = tick
    return slot


@helper
def _refine_column(k, height, refined):  # type: ignore[no-untyped-def]
    """Refine column k, which is level; return its slot."""
    slot = refined.num_used[0]
    refined.num_used[0] += 1
    top = height[k]
    refined.slot_of[k] = slot
    refined.cells[slot] = k
    refined.mean_height[slot] = top
    refined.initial_height[slot] = top
    for q in range(refined.subcolumn_height.shape[1]):
        refined.subcolumn_height[slot, q] = top
    for n in range(refined.removed_moments.shape[1]):
        refined.removed_moments[slot, n] = 0.0
    return slot


@helper
def rasterize_quad(a, b, c, d, raster):  # type: ignore[no-untyped-def]
    """Lower subcolumns to the two triangles (a, b, c) and (b, d, c) of four corners."""
    _rasterize_triangle(a, b, c, raster)
    _rasterize_triangle(b, d, c, raster)


@helper
def _rasterize_triangle(a, b, c, raster):  # type: ignore[no-untyped-def]
    """Lower the subcolumns whose sample points lie below a triangle of points (x, y, z) [m]."""
    height, refined, grid = raster.height, raster.refined, raster.grid
    # In units of subcolumns: the sample point of subcolumn (fi, fj) is at (u, v) = (fi, fj).
    fine = grid.cell / grid.subcolumns_per_side
    shift = 0.5 * grid.subcolumns_per_side - 0.5
    x, y = grid.x_first + shift * fine, grid.y_first + shift * fine
    ua, va = (x - a[0]) / fine - _SAMPLE_OFFSET_U, (y - a[1]) / fine - _SAMPLE_OFFSET_V
    ub, vb = (x - b[0]) / fine - _SAMPLE_OFFSET_U, (y - b[1]) / fine - _SAMPLE_OFFSET_V
    uc, vc = (x - c[0]) / fine - _SAMPLE_OFFSET_U, (y - c[1]) / fine - _SAMPLE_OFFSET_V
    area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va)
    if not _MIN_AREA < abs(area) < _MAX_AREA:
        return
    z_u = ((b[2] - a[2]) * (vc - va) - (c[2] - a[2]) * (vb - va)) / area
    z_v = ((ub - ua) * (c[2] - a[2]) - (uc - ua) * (b[2] - a[2])) / area
    lowest = max(min(a[2], b[2], c[2]), raster.floor)
    highest = max(a[2], b[2], c[2])
    # Clipped as floats: a cast of a number beyond the range of integers is undefined.
    rows, cols = (
        float(grid.rows * grid.subcolumns_per_side),
        float(grid.cols * grid.subcolumns_per_side),
    )
    first = np.int64(min(max(np.ceil(min(ua, ub, uc)), 0.0), rows))
    last = np.int64(max(min(np.floor(max(ua, ub, uc)), rows - 1.0), -1.0))
    for fi in range(first, last + 1):
        # No calls with tuples of arrays in this loop: Numba would count references to each array.
        low, high = _extend_span(fi, ua, va, ub, vb, np.inf, -np.inf)
        low, high = _extend_span(fi, ub, vb, uc, vc, low, high)
        low, high = _extend_span(fi, uc, vc, ua, va, low, high)
        j0 = np.int64(min(max(np.ceil(low - _SPAN_TOLERANCE), 0.0), cols))
        j1 = np.int64(max(min(np.floor(high + _SPAN_TOLERANCE), cols - 1.0), -1.0))
        for fj in range(j0, j1 + 1):
            # Limited to the heights of the corners: the slopes of a sliver are ill-conditioned.
            z = max(min(a[2] + z_u * (fi - ua) + z_v * (fj - va), highest), lowest)
            i, j = fi // grid.subcolumns_per_side, fj // grid.subcolumns_per_side
            slot = enter_column(i * grid.cols + j, z, height, refined, raster.tick)
            if slot >= 0:
                q = (fi - i * grid.subcolumns_per_side) * grid.subcolumns_per_side + (
                    fj - j * grid.subcolumns_per_side
                )
                _lower_subcolumn(refined, slot, q, x - fi * fine, y - fj * fine, z)


@helper(inline="always")
def _extend_span(u, ua, va, ub, vb, low, high):  # type: ignore[no-untyped-def]
    """Extend the span (low, high) to where the side from a to b crosses row u, if it does."""
    if (ua <= u) != (ub <= u):
        v = va + (u - ua) * (vb - va) / (ub - ua)
        low, high = min(low, v), max(high, v)
    return low, high


@helper(inline="always")
def _lower_subcolumn(refined, slot, q, x, y, z):  # type: ignore[no-untyped-def]
    """Lower subcolumn q, at x and y [m], to the height z [m] if it is higher."""
    lost = refined.subcolumn_height[slot, q] - z
    if lost > 0.0:
        refined.subcolumn_height[slot, q] = z
        refined.removed_moments[slot, REMOVED_HEIGHT] += lost
        refined.removed_moments[slot, MOMENT_X] += lost * x
        refined.removed_moments[slot, MOMENT_Y] += lost * y
        refined.removed_moments[slot, MOMENT_Z] += lost * (z + 0.5 * lost)
