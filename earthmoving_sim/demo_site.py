"""The site of the demo: real terrain scaled to a construction site; check of slope stability."""

from __future__ import annotations

import math

import numpy as np

from earthmoving_sim.run_config import RunConfig
from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.slope_failure.stability import critical_height
from soil_sim.terrain import HeightMap, from_north_up

__all__ = ["CELL", "POINTS", "check_slope_stability", "jacksboro_site"]

POINTS = 257
CELL = 0.2
"""Grid of the demo: 257 x 257 points, 0.2 m apart, about the spacing of a bucket's teeth."""

_CROP_POINTS = 65
"""Side of the piece cut out of the data [points]."""

_RELIEF = 2.5
"""Height of the site's highest point above its lowest [m]."""

_MAX_SLOPE = math.radians(20.0)
"""Maximum slope of the site [rad]."""

_MARGIN = 4.0
"""Distance beyond the machine's reach within which slopes are checked [m]."""


def jacksboro_site(*, row: int = 128, col: int = 144) -> HeightMap:
    """Return a piece of the Jacksboro fault, Tennessee, as a site of 51.4 m with 2.5 m of relief.

    The elevation data (USGS SRTM, about 90 m per cell) comes with matplotlib. Width and relief of
    the piece are scaled, and slopes are limited to 20 degrees, well below most angles of repose.

    Args:
        row: first row of the piece of 65 x 65 points in the data.
        col: first column; by default the ground is level where the excavator stands.
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
    """Check that the undisturbed ground within reach of the machine is stable.

    Ground steeper than the angle of repose is stable up to the height that its cohesion carries
    (Culmann).

    Raises:
        TerrainError: the ground is not stable, or the machine would stand off the map.
    """
    grid = site.grid
    reach = config.behaviour.max_radius + _MARGIN
    x, y = grid.x(np.arange(grid.rows)), grid.y(np.arange(grid.cols))
    rows = np.flatnonzero(np.abs(x - config.run.start_x) <= reach)
    cols = np.flatnonzero(np.abs(y - config.run.start_y) <= reach)
    if rows.size < 2 or cols.size < 2:
        raise TerrainError(
            f"the machine would dig at ({config.run.start_x}, {config.run.start_y}) m, off the map;"
            " set start_x and start_y in the section run",
            TerrainErrorCode.OFF_MAP,
        )
    near = site.cropped(int(rows[0]), int(cols[0]), rows.size, cols.size)
    soil = config.soil.soil_types()[0]
    moisture = soil.moisture if config.soil.moisture < 0 else config.soil.moisture
    repose_angle = soil.repose_angle_at(moisture)
    max_height = critical_height(
        soil.critical_height(moisture), 0.0, math.radians(soil.internal_friction), near.max_slope
    )
    if near.max_slope > repose_angle and np.ptp(near.heights) > max_height:
        raise TerrainError(
            f"the ground within reach has slopes of {math.degrees(near.max_slope):.0f} deg, and the"
            f" soil is stable up to {math.degrees(repose_angle):g} deg; give gentler ground, or a"
            " soil with more cohesion or a larger angle of repose",
            TerrainErrorCode.UNSTABLE_SLOPE,
        )
