"""Cut and fill: bulk volume between the ground and a design surface.

The difference of each designed column from the design, and the totals, are stored as whole mm^3.
The totals therefore do not depend on whether columns were updated one by one, in any order, or all
recomputed; each column is rounded by at most half a mm^3. The volumes are bulk volumes, as measured
by a survey of both surfaces: loose soil counts with its swell.
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
"""Default tolerance [m]: maximum difference from the design of a finished cell."""

_CUT, _FILL, _WITHIN, _NUM_TOTALS = 0, 1, 2, 3
"""Slots of the totals: cut and fill [mm^3], number of cells within the tolerance."""

_MAX_TOTAL_MM3 = 2**62
"""Maximum sum over all columns [mm^3], within the range of an int64."""

_SNAP_DISTANCE = 1e-6
"""Maximum distance at which a sample is moved to a point of the design [cells]; UTM coordinates, of
millions of metres, are rounded to about 1e-9 m."""


@dataclass(frozen=True, eq=False)
class DesignSurface:
    """Target surface of the ground.

    Attributes:
        grid: grid of the terrain.
        heights: design height [m], shape (rows, cols), float64, read-only, in matrix order; NaN
            without a design.

    Raises:
        SoilError: the shape is not that of the grid, a height is infinite or beyond
            `HEIGHT_LIMIT`, or no cell has a height.
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
                f" {float(heights[row, col])} m at row {row}, col {col}; give NaN for cells"
                " without a design"
            )
        if np.isnan(heights).all():
            raise SoilError("the design has no height in any cell; give at least one")
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)

    @property
    def has_design(self) -> NDArray[np.bool_]:
        """Cells that have a design, shape (rows, cols)."""
        return ~np.isnan(self.heights)


class CutFill:
    """Cut and fill between the ground and a design; `update` applies changes of the ground.

    Attributes:
        surface: the design.
        tolerance: maximum difference from the design of a finished cell [m].
        designed_cells: number of cells that have a design.
    """

    def __init__(
        self, surface: DesignSurface, elevation: ArrayLike, tolerance: float = DEFAULT_TOLERANCE
    ) -> None:
        """Compare all cells; arguments and errors are those of `compare_to_design`."""
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
        # Initially every column is exactly at its design height.
        self._totals = np.zeros(_NUM_TOTALS, dtype=np.int64)
        self._totals[_WITHIN] = self.designed_cells
        indices = np.arange(heights.size)
        self._update_cells(indices, heights.reshape(-1))

    @property
    def cut(self) -> float:
        """Bulk volume to remove [m^3]: the sum of max(elevation - design, 0) * cell area."""
        return self.cut_mm3 * 1e-9

    @property
    def fill(self) -> float:
        """Bulk volume to add [m^3]: the sum of max(design - elevation, 0) * cell area."""
        return self.fill_mm3 * 1e-9

    @property
    def remaining(self) -> float:
        """Sum of cut and fill [m^3]; 0 if the ground equals the design."""
        return (self.cut_mm3 + self.fill_mm3) * 1e-9

    @property
    def cut_mm3(self) -> int:
        """`cut` in whole mm^3."""
        return int(self._totals[_CUT])

    @property
    def fill_mm3(self) -> int:
        """`fill` in whole mm^3."""
        return int(self._totals[_FILL])

    @property
    def within_tolerance(self) -> float:
        """Fraction of the designed cells that differ by at most the tolerance, 0..1.

        Volumes are compared: the comparison is exact to half a mm^3 over the area of a cell.
        """
        return int(self._totals[_WITHIN]) / self.designed_cells

    @property
    def difference(self) -> NDArray[np.float32]:
        """Elevation minus design [m], shape (rows, cols), NaN where there is no design.

        A read-only view that `update` changes. Positive values are soil to remove.
        """
        return self._view

    def update(
        self, rows: NDArray[np.integer], cols: NDArray[np.integer], elevation: ArrayLike
    ) -> None:
        """Apply new heights of cells; the result equals that of comparing all cells, bit by bit.

        Args:
            rows, cols: indices of the cells, shape (n,). The last entry of a repeated cell counts.
            elevation: new heights of the cells [m], shape (n,).

        Raises:
            SoilError: the shapes differ, a cell is outside of the map or a height is not finite;
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
                f"a cell is outside of the map; give rows 0 to {grid.rows - 1}, cols 0 to"
                f" {grid.cols - 1}"
            )
        self._update_cells(rows.astype(np.int64) * grid.cols + cols.astype(np.int64), heights)

    def _update_cells(self, indices: NDArray[np.int64], heights: NDArray[np.float64]) -> None:
        """Apply new heights of cells, given by flat index, shape (n,)."""
        if not np.isfinite(heights).all():
            raise SoilError(
                f"{int((~np.isfinite(heights)).sum())} elevations are not finite; give the height"
                " of every cell"
            )
        difference = heights - self.surface.heights.reshape(-1)[indices]
        volume = np.rint(difference * self._mm3_per_metre)
        if (np.abs(volume) > self._max_column_mm3).any():  # false for NaN, without a design
            raise SoilError(
                f"a column is {np.nanmax(np.abs(difference)):g} m from the design, too much to sum"
                " over the map; use smaller cells or a smaller map"
            )
        limit = np.int64(min(np.rint(self.tolerance * self._mm3_per_metre), self._max_column_mm3))
        _apply_differences(
            indices,
            difference,
            volume,
            limit,
            self._difference.reshape(-1),
            self._volumes_mm3.reshape(-1),
            self._totals,
        )


def compare_to_design(
    surface: DesignSurface, elevation: ArrayLike, *, tolerance: float = DEFAULT_TOLERANCE
) -> CutFill:
    """Return the cut and fill between the ground and a design.

    Args:
        surface: the design.
        elevation: height of the ground [m], shape (rows, cols), matrix order, finite.
        tolerance: maximum difference from the design of a finished cell [m].

    Raises:
        SoilError: the elevation has another shape than the design or is not finite, the tolerance
            is negative or not finite, or the volumes do not fit into an int64 of mm^3.
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
    """Read a design from a terrain file and resample it to the grid of the terrain.

    If file and terrain both have a georeference, it determines position and elevation of the
    design; otherwise the centres of both coincide and the heights are z in the map frame. Heights
    between the points of the design are interpolated bilinearly. Beyond the outer points, within
    the outer cells, the nearest point counts. There is no design outside, and next to a
    point without a height.

    Args:
        path: file with a suffix of `SUFFIXES`; cells without a height have no design.
        grid: grid of the terrain.
        georeference: georeference of the terrain.
        cell, vertical_scale, height_range: as for `load_terrain`.

    Raises:
        TerrainError: the file cannot be read, its crs is not that of the terrain, or the design has
            no height on the terrain. The message starts with the path.
    """
    path = Path(path)
    own, heights, place = load_heights_with_nodata(
        path, cell=cell, vertical_scale=vertical_scale, height_range=height_range
    )
    with wrap_read_errors(path):
        # Check before interpolation, which would mix an undeclared nodata value into neighbours.
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
        resampled = _bilinear(heights, u, v) + up
        if np.isnan(resampled).all():
            raise TerrainError(
                f"the design, {own.size[0]:g} x {own.size[1]:g} m with its centre {east:g} m east"
                f" and {north:g} m north of the terrain's, has no height on the terrain of"
                f" {grid.size[0]:g} x {grid.size[1]:g} m; check their coordinates"
            )
        return DesignSurface(grid, resampled)


def _snap_to_points(index: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return fractional indices; those next to a point become exact, as does its height."""
    nearest = np.rint(index)
    return np.where(np.abs(index - nearest) <= _SNAP_DISTANCE, nearest, index)


def _bilinear(
    heights: NDArray[np.float64], u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return heights at fractional rows `u` and columns `v`, shape (len(u), len(v)).

    They are NaN more than half a cell outside of the outer points, and where a point with a weight
    above 0 is NaN.
    """
    rows, cols = heights.shape
    half = 0.5 + _SNAP_DISTANCE
    is_outside = (u < -half) | (u > rows - 1 + half)
    along_x = _interpolate_rows(heights, np.clip(u, 0.0, rows - 1.0))
    along_x[is_outside] = np.nan
    is_outside = (v < -half) | (v > cols - 1 + half)
    both = _interpolate_rows(along_x.T, np.clip(v, 0.0, cols - 1.0))
    both[is_outside] = np.nan
    return both.T


def _interpolate_rows(heights: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows interpolated linearly at fractional indices `u`; NaN of weight 0 is ignored."""
    i = np.minimum(u.astype(np.intp), heights.shape[0] - 2)
    s = (u - i)[:, None]
    mixed = heights[i] * (1.0 - s) + heights[i + 1] * s
    mixed = np.where(s == 0.0, heights[i], mixed)
    return np.asarray(np.where(s == 1.0, heights[i + 1], mixed))


@kernel
def _apply_differences(  # type: ignore[no-untyped-def]
    indices, difference, volume, limit, all_differences, all_volumes, totals
):
    """Replace differences and volumes of some cells, and update the totals.

    Args:
        indices: flat indices of the cells, shape (n,).
        difference: elevation minus design [m], shape (n,), NaN without a design.
        volume: `difference` times the cell area [mm^3], shape (n,).
        limit: maximum volume of a finished cell [mm^3].
        all_differences, all_volumes: in and out, those of all cells, flat.
        totals: in and out, see `_CUT`, `_FILL` and `_WITHIN`.
    """
    for k in range(len(indices)):
        if np.isnan(difference[k]):
            continue
        i = indices[k]
        old, new = all_volumes[i], np.int64(volume[k])
        totals[_CUT] += max(new, 0) - max(old, 0)
        totals[_FILL] += max(-new, 0) - max(-old, 0)
        totals[_WITHIN] += np.int64(abs(new) <= limit) - np.int64(abs(old) <= limit)
        all_volumes[i] = new
        all_differences[i] = difference[k]
