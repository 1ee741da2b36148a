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
)

__all__ = [
    "Raster",
    "RasterTables",
    "SubcolumnGrid",
    "raster_in_tick",
    "rasterize_quad",
    "refine_column",
]

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

    The arrays of the refined columns are fields of their own: Numba counts references to all arrays
    of a nested tuple wherever it is read.

    Attributes:
        height: surface of each column of the map [m], flat.
        floor: height of the undiggable floor [m].
        slot_of, cells, last_tick, subcolumn_height, mean_height, initial_height,
            removed_moments: fields of `RefinedArrays`; changed.
        grid: the grid of subcolumns.
        tick: number of the tick.
    """

    height: NDArray[np.float64]
    floor: float
    slot_of: NDArray[np.int64]
    cells: NDArray[np.int64]
    last_tick: NDArray[np.int64]
    subcolumn_height: NDArray[np.float64]
    mean_height: NDArray[np.float64]
    initial_height: NDArray[np.float64]
    removed_moments: NDArray[np.float64]
    grid: SubcolumnGrid
    tick: int


class RasterTables(NamedTuple):
    """The fields of a `Raster` but the tick, to be boxed: they change only with the allocation."""

    height: NDArray[np.float64]
    floor: float
    slot_of: NDArray[np.int64]
    cells: NDArray[np.int64]
    last_tick: NDArray[np.int64]
    subcolumn_height: NDArray[np.float64]
    mean_height: NDArray[np.float64]
    initial_height: NDArray[np.float64]
    removed_moments: NDArray[np.float64]
    grid: SubcolumnGrid


@helper(allocates=True)
def raster_in_tick(tables, tick):  # type: ignore[no-untyped-def]
    """Return the `Raster` of some `RasterTables` in a tick."""
    return Raster(
        tables.height,
        tables.floor,
        tables.slot_of,
        tables.cells,
        tables.last_tick,
        tables.subcolumn_height,
        tables.mean_height,
        tables.initial_height,
        tables.removed_moments,
        tables.grid,
        tick,
    )


@helper
def refine_column(raster, k, slot):  # type: ignore[no-untyped-def]
    """Refine column k, which is level, in a free slot."""
    top = raster.height[k]
    raster.slot_of[k] = slot
    raster.cells[slot] = k
    raster.mean_height[slot] = top
    raster.initial_height[slot] = top
    for q in range(raster.subcolumn_height.shape[1]):
        raster.subcolumn_height[slot, q] = top
    for n in range(raster.removed_moments.shape[1]):
        raster.removed_moments[slot, n] = 0.0


@helper
def rasterize_quad(a, b, c, d, raster, count):  # type: ignore[no-untyped-def]
    """Lower subcolumns to the two triangles (a, b, c) and (b, d, c) of four corners.

    Args:
        a, b, c, d: the corners (x, y, z) [m].
        raster: the `Raster`; changed.
        count: number of refined columns.

    Returns:
        The number of refined columns.
    """
    count = _rasterize_triangle(a, b, c, raster, count)
    return _rasterize_triangle(b, d, c, raster, count)


@helper
def _rasterize_triangle(a, b, c, raster, count):  # type: ignore[no-untyped-def]
    """Lower the subcolumns whose sample points lie below a triangle; return the number of refined
    columns."""
    grid, per_side = raster.grid, raster.grid.subcolumns_per_side
    # In units of subcolumns: the sample point of subcolumn (fi, fj) is at (u, v) = (fi, fj).
    fine = grid.cell / per_side
    shift = 0.5 * per_side - 0.5
    x, y = grid.x_first + shift * fine, grid.y_first + shift * fine
    ua, va = (x - a[0]) / fine - _SAMPLE_OFFSET_U, (y - a[1]) / fine - _SAMPLE_OFFSET_V
    ub, vb = (x - b[0]) / fine - _SAMPLE_OFFSET_U, (y - b[1]) / fine - _SAMPLE_OFFSET_V
    uc, vc = (x - c[0]) / fine - _SAMPLE_OFFSET_U, (y - c[1]) / fine - _SAMPLE_OFFSET_V
    area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va)
    if not _MIN_AREA < abs(area) < _MAX_AREA:
        return count
    z_u = ((b[2] - a[2]) * (vc - va) - (c[2] - a[2]) * (vb - va)) / area
    z_v = ((ub - ua) * (c[2] - a[2]) - (uc - ua) * (b[2] - a[2])) / area
    lowest = max(min(a[2], b[2], c[2]), raster.floor)
    highest = max(a[2], b[2], c[2])
    # Clipped as floats: a cast of a number beyond the range of integers is undefined.
    rows, cols = float(grid.rows * per_side), float(grid.cols * per_side)
    first = np.int64(min(max(np.ceil(min(ua, ub, uc)), 0.0), rows))
    last = np.int64(max(min(np.floor(max(ua, ub, uc)), rows - 1.0), -1.0))
    for fi in range(first, last + 1):
        # No helpers that take the raster in this loop: Numba would count references to its arrays.
        low, high = _extend_span(fi, ua, va, ub, vb, np.inf, -np.inf)
        low, high = _extend_span(fi, ub, vb, uc, vc, low, high)
        low, high = _extend_span(fi, uc, vc, ua, va, low, high)
        j0 = np.int64(min(max(np.ceil(low - _SPAN_TOLERANCE), 0.0), cols))
        j1 = np.int64(max(min(np.floor(high + _SPAN_TOLERANCE), cols - 1.0), -1.0))
        # Divisions of integers take as long as the rest of the loop over fj: one for a row of it.
        i, j = fi // per_side, j0 // per_side
        first_q, aside = (fi - i * per_side) * per_side, j0 - j * per_side - 1
        for fj in range(j0, j1 + 1):
            aside += 1
            if aside == per_side:
                j, aside = j + 1, 0
            # Limited to the heights of the corners: the slopes of a sliver are ill-conditioned.
            z = max(min(a[2] + z_u * (fi - ua) + z_v * (fj - va), highest), lowest)
            k = np.uint64(i * grid.cols + j)
            slot = raster.slot_of[k]
            if slot < 0:
                if not z < raster.height[k]:
                    continue
                slot = count
                count += 1
                refine_column(raster, np.int64(k), slot)
            n, q = np.uint64(slot), np.uint64(first_q + aside)
            if z <= raster.initial_height[n]:
                raster.last_tick[n] = raster.tick
            lost = raster.subcolumn_height[n, q] - z
            if lost > 0.0:
                raster.subcolumn_height[n, q] = z
                raster.removed_moments[n, REMOVED_HEIGHT] += lost
                raster.removed_moments[n, MOMENT_X] += lost * (x - fi * fine)
                raster.removed_moments[n, MOMENT_Y] += lost * (y - fj * fine)
                raster.removed_moments[n, MOMENT_Z] += lost * (z + 0.5 * lost)
    return count


@helper(forceinline=True)
def _extend_span(u, ua, va, ub, vb, low, high):  # type: ignore[no-untyped-def]
    """Extend the span (low, high) to where the side from a to b crosses row u, if it does."""
    if (ua <= u) != (ub <= u):
        v = va + (u - ua) * (vb - va) / (ub - ua)
        low, high = min(low, v), max(high, v)
    return low, high
