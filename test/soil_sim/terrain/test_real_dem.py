"""A real DEM becomes a site: cropped, resampled to 0.2 m and scaled to the size of a machine."""

import math

import matplotlib.cbook
import numpy as np
import pytest

from msg_bridge.contract.grid import Grid
from soil_sim.terrain import HeightMap, from_north_up


@pytest.fixture(scope="module")
def mountains() -> HeightMap:
    """Return the Jacksboro fault (SRTM, 236 to 1076 m), which is part of Matplotlib."""
    with matplotlib.cbook.get_sample_data("jacksboro_fault_dem.npz") as dem:
        return from_north_up(dem["elevation"], 90.0)


def site(mountains: HeightMap) -> HeightMap:
    square = mountains.cropped(100, 50, 129, 129)
    return square.with_cell(0.4).resampled(257, 257, 0.2)


def test_site_from_dem_has_257_points_at_0_2_m(mountains):
    assert site(mountains).grid == Grid(257, 257, 0.2)


def test_site_interpolates_the_heights_of_the_dem(mountains):
    crop = mountains.heights[100:229, 50:179]
    assert np.array_equal(site(mountains).heights[::2, ::2], crop)


def test_site_has_the_requested_relief(mountains):
    assert site(mountains).with_relief(4.0).relief == pytest.approx(4.0)


def test_site_has_the_requested_slope_limit(mountains):
    limit = math.radians(20.0)
    assert limit * (1 - 1e-6) < site(mountains).with_slope_limit(limit).max_slope <= limit
