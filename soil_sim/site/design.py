"""Design surface: target heights of the ground, given or read from a terrain file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain.file_access import wrap_read_errors
from soil_sim.terrain.files import load_heights_with_nodata
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.geotiff import same_crs
from soil_sim.terrain.height_map import HEIGHT_LIMIT, as_height_array

__all__ = ["DesignSurface", "load_design"]

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
        TerrainError: the shape is not that of the grid, a height is infinite or beyond
            `HEIGHT_LIMIT`, or no cell has a height.
    """

    grid: Grid
    heights: NDArray[np.float64]

    def __post_init__(self) -> None:
        heights = as_height_array(self.heights, "design heights").copy()
        if heights.shape != self.grid.shape:
            raise TerrainError(
                f"the design has shape {heights.shape}, the terrain {self.grid.shape}; give a"
                " height, or NaN, for each cell of the terrain",
                TerrainErrorCode.SHAPE,
            )
        bad = np.argwhere(np.abs(heights) > HEIGHT_LIMIT)
        if bad.size:
            row, col = (int(index) for index in bad[0])
            raise TerrainError(
                f"{len(bad)} design heights are beyond {HEIGHT_LIMIT:g} m, the first"
                f" {float(heights[row, col])} m at row {row}, col {col}; give NaN for cells"
                " without a design",
                TerrainErrorCode.HEIGHT,
            )
        if np.isnan(heights).all():
            raise TerrainError(
                "the design has no height in any cell; give at least one", TerrainErrorCode.HEIGHT
            )
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)

    @property
    def has_design(self) -> NDArray[np.bool_]:
        """Cells that have a design, shape (rows, cols)."""
        return ~np.isnan(self.heights)


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
                    f"its crs is {place.crs!r}, the terrain's {georeference.crs!r}; reproject it",
                    TerrainErrorCode.GEOREFERENCE,
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
                f" {grid.size[0]:g} x {grid.size[1]:g} m; check their coordinates",
                TerrainErrorCode.OFF_MAP,
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
