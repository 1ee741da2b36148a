"""The site of the demo: real ground, shrunk to the size of a building site; and its fitness."""

from __future__ import annotations

import math

import numpy as np

from earthmoving_sim.run_config import RunConfig
from soil_sim.errors import TerrainError
from soil_sim.terrain import HeightMap, from_north_up

__all__ = ["CELL", "POINTS", "check_slope_stability", "jacksboro_site"]

POINTS = 257
CELL = 0.2
"""The demo's grid: 257 x 257 points, 0.2 m apart, as fine as a bucket's teeth are far apart."""

_CROP_POINTS = 65
_RELIEF = 2.5
_MAX_SLOPE = math.radians(20.0)


def jacksboro_site(*, row: int = 128, col: int = 144) -> HeightMap:
    """A piece of the Jacksboro fault, Tennessee, as a site of 51.4 m with 2.5 m of relief.

    The elevation data (USGS SRTM, about 90 m a cell) comes with matplotlib. The piece keeps its
    shape; its width and relief are scaled, and no slope is left steeper than 20 degrees, well
    below the angle at which soil slips.

    Args:
        row, col: first row and column of the piece of 65 x 65 points in the data; the default
            is level where the excavator stands.
    """
    from matplotlib.cbook import get_sample_data

    path = str(get_sample_data("jacksboro_fault_dem.npz", asfileobj=False))
    with np.load(path) as data:
        elevation = data["elevation"].astype(np.float64)
    data_cell = (POINTS - 1) * CELL / (_CROP_POINTS - 1)
    piece = from_north_up(elevation, data_cell).cropped(row, col, _CROP_POINTS, _CROP_POINTS)
    site = piece.resampled(POINTS, POINTS, CELL).with_relief(_RELIEF)
    return site.with_slope_limit(_MAX_SLOPE).with_datum_raised(float(site.heights.mean()))


def check_slope_stability(site: HeightMap, config: RunConfig) -> None:
    """Refuse ground that would come down as soon as it is touched.

    Raises:
        TerrainError: it is steeper within reach than the soil can stand.
    """
    grid = site.grid
    reach = config.behaviour.max_radius + 4.0
    x, y = grid.x(np.arange(grid.rows)), grid.y(np.arange(grid.cols))
    rows = np.flatnonzero(np.abs(x - config.run.start_x) <= reach)
    cols = np.flatnonzero(np.abs(y - config.run.start_y) <= reach)
    if rows.size < 2 or cols.size < 2:
        raise TerrainError(
            f"the machine is to dig at ({config.run.start_x}, {config.run.start_y}) m, off the map;"
            " set start_x and start_y in the section run"
        )
    near = site.cropped(int(rows[0]), int(cols[0]), rows.size, cols.size)
    steepest = math.degrees(near.max_slope)
    kind = config.soil.soil_types()[0]
    angle = math.degrees(kind.repose_angle_at(kind.moisture))
    if steepest > angle:
        raise TerrainError(
            f"the ground within reach has slopes of {steepest:.0f} deg, and the soil stands at"
            f" {angle:g} deg: give gentler ground, or raise repose_angle in the"
            " section soil"
        )
