"""jacksboro_site: its grid, relief and slopes; check_slope_stability."""

import math

import numpy as np
import pytest
from support.terrain_errors import raises_terrain_error

from earthmoving_sim.demo_site import CELL, POINTS, check_slope_stability, jacksboro_site
from earthmoving_sim.run_config import load_run_config
from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainErrorCode
from soil_sim.terrain import HeightMap, slope


@pytest.fixture(scope="module")
def site() -> HeightMap:
    return jacksboro_site()


def test_site_has_the_demos_grid(site):
    assert site.grid.shape == (257, 257) == (POINTS, POINTS)
    assert site.grid.cell == 0.2 == CELL
    assert site.heights.shape == site.grid.shape


def test_site_has_relief_about_height_zero(site):
    assert 1.5 < np.ptp(site.heights) <= 2.5 + 1e-9
    assert site.heights.mean() == pytest.approx(0.0, abs=1e-6)


def test_no_slope_is_steeper_than_20_degrees(site):
    max_gradient = math.tan(math.radians(20.0))
    for axis in (0, 1):
        assert np.abs(np.diff(site.heights, axis=axis)).max() / CELL <= max_gradient + 1e-6


def test_ground_is_level_where_the_machine_stands(site):
    grid = site.grid
    x, y = np.meshgrid(grid.x(np.arange(POINTS)), grid.y(np.arange(POINTS)), indexing="ij")
    stand = (x >= -8) & (x <= -2) & (np.abs(y) <= 2)
    plane = np.column_stack([x[stand], y[stand], np.ones(stand.sum())])
    (rise_x, rise_y, _), *_ = np.linalg.lstsq(plane, site.heights[stand], rcond=None)
    assert math.degrees(math.atan(math.hypot(rise_x, rise_y))) <= 3.0


def test_site_is_the_same_every_time(site):
    assert (jacksboro_site().heights == site.heights).all()


def test_other_piece_of_the_data_gives_another_site(site):
    other = jacksboro_site(row=20, col=30)
    assert other.grid == site.grid
    assert np.abs(other.heights - site.heights).max() > 0.1


def test_cohesion_makes_slopes_stable_beyond_the_angle_of_repose():
    ground = slope(Grid(129, 129, 0.2), np.radians(38.0), 0.0)
    check_slope_stability(ground, load_run_config(soil="rock"))
    with raises_terrain_error(TerrainErrorCode.UNSTABLE_SLOPE):
        check_slope_stability(ground, load_run_config())
