"""What is still to dig and to fill: the ground against the surface it shall become.

Every designed column's difference from the design is kept as a whole number of mm^3 of room, and so
are the totals. They are therefore the same, to the last bit, whether columns were updated one by
one, in any order, or all compared anew; only each column is rounded, by at most half a mm^3. Room
is what a surveyor measures between two surfaces: loose soil counts with its swell.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.kernels import kernel
from soil_sim.errors import SoilError, TerrainError
from soil_sim.terrain.file_access import wrap_read_errors
from soil_sim.terrain.files import load_heights_with_nodata
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.geotiff import same_crs
from soil_sim.terrain.height_map import HEIGHT_LIMIT, as_height_array

__all__ = ["DEFAULT_TOLERANCE", "CutFill", "DesignSurface", "compare_to_design", "load_design"]

DEFAULT_TOLERANCE = 0.05
"""Difference from the design that passes for done [m], unless another is given."""

_MAX_TOTAL_MM3 = 2**62
"""Above this the sum over all columns would not be safe in an int64."""

_SNAP_DISTANCE = 1e-6
"""A sample this close to a point of the design [cells] is that point; UTM coordinates, of millions
of metres, are rounded to about 1e-9 m."""


@dataclass(frozen=True, eq=False)
class DesignSurface:
    """The surface that the ground shall become.

    Attributes:
        grid: that of the terrain.
        heights: design height [m], shape (rows, cols), float64, read-only, in matrix order; NaN
            where nothing is designed.

    Raises:
        SoilError: the shape is not the grid's, a height is infinite or beyond `HEIGHT_LIMIT`, or
            no cell has one.
    """

    grid: Grid
    heights: NDArray[np.float64]

    def __post_init__(self) -> None:
        heights = as_height_array(self.heights, "design heights").copy()
        if heights.shape != self.grid.shape:
            raise SoilError(
                f"the design has shape {heights.shape}, the terrain {self.grid.shape}; give a"
                " height, or NaN, for each cell of the terrain"
            )
        bad = np.argwhere(np.abs(heights) > HEIGHT_LIMIT)
        if bad.size:
            row, col = (int(index) for index in bad[0])
            raise SoilError(
                f"{len(bad)} design heights are beyond {HEIGHT_LIMIT:g} m, the first"
                f" {float(heights[row, col])} m at row {row}, col {col}; give NaN where nothing is"
                " designed"
            )
        if np.isnan(heights).all():
            raise SoilError("the design has no height in any cell; give at least one")
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)

    @property
    def has_design(self) -> NDArray[np.bool_]:
        """Where there is a design, shape (rows, cols)."""
        return ~np.isnan(self.heights)


class CutFill:
    """How far the ground is from a design; `compare_to_design` makes one and `update` keeps it current.

    Attributes:
        surface: the design.
        tolerance: difference that passes for done [m].
        designed_cells: number of cells that have a design.
    """

    def __init__(
        self, surface: DesignSurface, elevation: ArrayLike, tolerance: float = DEFAULT_TOLERANCE
    ) -> None:
        """Compare all cells; see `compare_to_design`."""
        grid = surface.grid
        if not (np.isfinite(tolerance) and tolerance >= 0.0):
            raise SoilError(f"tolerance is {tolerance!r} m; give a finite height, not negative")
        heights = as_height_array(elevation, "elevations")
        if heights.shape != grid.shape:
            raise SoilError(
                f"the elevation has shape {heights.shape}, the design {grid.shape}; give one for"
                " each cell"
            )
        self.surface = surface
        self.tolerance = tolerance
        self.designed_cells = int(surface.has_design.sum())
        self._difference = np.full(grid.shape, np.nan, dtype=np.float32)
        self._view = self._difference.view()
        self._view.setflags(write=False)
        self._mm3_per_metre = grid.cell_area_mm2 * 1e3
        self._max_column_mm3 = _MAX_TOTAL_MM3 // (grid.rows * grid.cols)
        self._volumes_mm3: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        # All columns begin as exactly on the design.
        self._totals = np.array([0, 0, self.designed_cells], dtype=np.int64)
        indices = np.arange(heights.size)
        self._update_cells(indices, heights.reshape(-1))

    @property
    def cut(self) -> float:
        """Room still to remove [m^3]: the sum of max(elevation - design, 0) * cell area."""
        return self.cut_mm3 * 1e-9

    @property
    def fill(self) -> float:
        """Room still to add [m^3]: the sum of max(design - elevation, 0) * cell area."""
        return self.fill_mm3 * 1e-9

    @property
    def remaining(self) -> float:
        """Cut and fill together [m^3]: 0 when the ground is the design."""
        return (self.cut_mm3 + self.fill_mm3) * 1e-9

    @property
    def cut_mm3(self) -> int:
        """`cut`, whole mm^3."""
        return int(self._totals[0])

    @property
    def fill_mm3(self) -> int:
        """`fill`, whole mm^3."""
        return int(self._totals[1])

    @property
    def within_tolerance(self) -> float:
        """Fraction of the designed cells that differ by at most the tolerance, 0..1.

        Their room is compared, so it is exact to half a mm^3 over a cell's area.
        """
        return int(self._totals[2]) / self.designed_cells

    @property
    def difference(self) -> NDArray[np.float32]:
        """Elevation minus design [m], shape (rows, cols), NaN where there is no design.

        Read-only, and current: it follows `update`. Positive is soil to remove.
        """
        return self._view

    def update(
        self, rows: NDArray[np.integer], cols: NDArray[np.integer], elevation: ArrayLike
    ) -> None:
        """Follow the given cells; the result is that of comparing anew, to the last bit.

        Args:
            rows, cols: the cells, shape (n,). Of a cell that comes twice the last counts.
            elevation: their height now [m], shape (n,).

        Raises:
            SoilError: shapes that differ, a cell beyond the map or a height that is not finite;
                nothing was changed.
        """
        rows, cols = np.asarray(rows), np.asarray(cols)
        heights = np.asarray(elevation, dtype=np.float64)
        if not (rows.ndim == 1 and rows.shape == cols.shape == heights.shape):
            raise SoilError(
                f"rows, cols and elevation have shapes {rows.shape}, {cols.shape},"
                f" {heights.shape}; give one of each for every cell"
            )
        if rows.size == 0:
            return
        if rows.dtype.kind not in "iu" or cols.dtype.kind not in "iu":
            raise SoilError(
                f"rows and cols are of type {rows.dtype} and {cols.dtype}; give integers"
            )
        grid = self.surface.grid
        if min(rows.min(), cols.min()) < 0 or rows.max() >= grid.rows or cols.max() >= grid.cols:
            raise SoilError(
                f"a cell is beyond the map; give rows 0 to {grid.rows - 1}, cols 0 to"
                f" {grid.cols - 1}"
            )
        self._update_cells(rows.astype(np.int64) * grid.cols + cols.astype(np.int64), heights)

    def _update_cells(self, indices: NDArray[np.int64], heights: NDArray[np.float64]) -> None:
        """Follow cells by their flat indices, shape (n,)."""
        if not np.isfinite(heights).all():
            raise SoilError(
                f"{int((~np.isfinite(heights)).sum())} elevations are not finite; give the height"
                " of every cell"
            )
        difference = heights - self.surface.heights.reshape(-1)[indices]
        room = np.rint(difference * self._mm3_per_metre)
        if (np.abs(room) > self._max_column_mm3).any():  # NaN, where nothing is designed, is not
            raise SoilError(
                f"a column is {np.nanmax(np.abs(difference)):g} m from the design, too much to sum"
                " over the map; use smaller cells or a smaller map"
            )
        limit = np.int64(min(np.rint(self.tolerance * self._mm3_per_metre), self._max_column_mm3))
        _apply_differences(
            indices,
            difference,
            room,
            limit,
            self._difference.reshape(-1),
            self._volumes_mm3.reshape(-1),
            self._totals,
        )


def compare_to_design(
    surface: DesignSurface, elevation: ArrayLike, *, tolerance: float = DEFAULT_TOLERANCE
) -> CutFill:
    """How far the ground is from a design.

    Args:
        surface: the design.
        elevation: height of the ground [m], shape (rows, cols), matrix order, finite.
        tolerance: difference that passes for done [m].

    Raises:
        SoilError: the elevation has another shape than the design or is not finite, the
            tolerance is negative or not finite, or the volumes do not fit into an int64 of mm^3.
    """
    return CutFill(surface, elevation, tolerance)


def load_design(
    path: str | os.PathLike[str],
    grid: Grid,
    *,
    georeference: Georeference | None = None,
    cell: float | None = None,
    vertical_scale: float = 1.0,
    height_range: tuple[float, float] | None = None,
) -> DesignSurface:
    """A design from any terrain file, laid out on the terrain's grid.

    Where file and terrain both have a georeference the design lies, and is as high, as those say;
    else its centre is the terrain's and its heights are the map frame's z. Heights between the
    design's points are bilinear, beyond its outer points but within its outer cells those of the
    nearest point. Where one of the points has no height, and outside, nothing is designed.

    Args:
        path: a file with one of the suffixes of terrain; its missing heights are undesigned.
        grid: that of the terrain.
        georeference: that of the terrain.
        cell, vertical_scale, height_range: as for `load_terrain`.

    Raises:
        TerrainError: the file cannot be read, its crs is not the terrain's, or the design has no
            height on the terrain. The message starts with the path.
    """
    path = Path(path)
    own, heights, place = load_heights_with_nodata(
        path, cell=cell, vertical_scale=vertical_scale, height_range=height_range
    )
    with wrap_read_errors(path):
        # As read, so that a mark of a missing height is not blurred into its neighbours.
        heights = DesignSurface(own, heights).heights
        east = north = up = 0.0
        if place is not None and georeference is not None:
            if not same_crs(place.crs, georeference.crs):
                raise TerrainError(
                    f"its crs is {place.crs!r}, the terrain's {georeference.crs!r}; reproject it"
                )
            east = place.easting - georeference.easting
            north = place.northing - georeference.northing
            up = place.elevation - georeference.elevation
        u = _snap_to_points(own.row(grid.x(np.arange(grid.rows)) - east))
        v = _snap_to_points(own.col(grid.y(np.arange(grid.cols)) - north))
        laid_out = _bilinear(heights, u, v) + up
        if np.isnan(laid_out).all():
            raise TerrainError(
                f"the design, {own.size[0]:g} x {own.size[1]:g} m with its centre {east:g} m east"
                f" and {north:g} m north of the terrain's, has no height on the terrain of"
                f" {grid.size[0]:g} x {grid.size[1]:g} m; check their coordinates"
            )
        return DesignSurface(grid, laid_out)


def _snap_to_points(index: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fractional indices, those on a point made exact: rounding must not blur heights."""
    nearest = np.rint(index)
    return np.where(np.abs(index - nearest) <= _SNAP_DISTANCE, nearest, index)


def _bilinear(
    heights: NDArray[np.float64], u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Heights at fractional rows `u` and columns `v`, shape (len(u), len(v)).

    NaN beyond half a cell outside the outer points, and where a point with weight is NaN.
    """
    rows, cols = heights.shape
    half = 0.5 + _SNAP_DISTANCE
    outside = (u < -half) | (u > rows - 1 + half)
    along_x = _interpolate_rows(heights, np.clip(u, 0.0, rows - 1.0))
    along_x[outside] = np.nan
    outside = (v < -half) | (v > cols - 1 + half)
    both = _interpolate_rows(along_x.T, np.clip(v, 0.0, cols - 1.0))
    both[outside] = np.nan
    return both.T


def _interpolate_rows(heights: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows at fractional indices `u`, linear; a NaN without weight does not count."""
    i = np.minimum(u.astype(np.intp), heights.shape[0] - 2)
    s = (u - i)[:, None]
    mixed = heights[i] * (1.0 - s) + heights[i + 1] * s
    mixed = np.where(s == 0.0, heights[i], mixed)
    return np.asarray(np.where(s == 1.0, heights[i + 1], mixed))


@kernel
def _apply_differences(indices, difference, room, limit, kept, kept_room, totals):  # type: ignore[no-untyped-def]
    """Put new differences [m] and rooms [mm^3] in the place of the old, and follow the totals.

    Undesigned cells have NaN. `totals` are cut, fill [mm^3] and the cells within `limit` [mm^3].
    """
    for k in range(len(indices)):
        if np.isnan(difference[k]):
            continue
        i = indices[k]
        old, new = kept_room[i], np.int64(room[k])
        totals[0] += max(new, 0) - max(old, 0)
        totals[1] += max(-new, 0) - max(-old, 0)
        totals[2] += np.int64(abs(new) <= limit) - np.int64(abs(old) <= limit)
        kept_room[i] = new
        kept[i] = difference[k]
