"""Height maps: validation, crop, resampling, relief and slope limit."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainErrorCode
from soil_sim.terrain import Georeference, HeightMap, slope

GRID = Grid(5, 7, 0.5)
PLACE = Georeference("EPSG:32633", 500_000.0, 5_200_000.0, 12.0)


def ground(seed: int = 0, grid: Grid = GRID) -> HeightMap:
    heights = np.random.default_rng(seed).normal(size=grid.shape)
    return HeightMap(grid, heights, PLACE)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, -9999.0, -32768.0, 1e20])
def test_error_of_an_invalid_height_has_its_cell(bad):
    heights = np.zeros(GRID.shape)
    heights[3, 5] = bad
    with raises_terrain_error(
        TerrainErrorCode.HEIGHT, match=r"row 3, col 5.*fill such cells or crop"
    ):
        HeightMap(GRID, heights)


def test_heights_of_another_shape_are_rejected():
    with raises_terrain_error(TerrainErrorCode.SHAPE):
        HeightMap(GRID, np.zeros((7, 5)))


@pytest.mark.parametrize(
    "heights",
    [
        np.zeros(GRID.shape, dtype=complex),
        np.zeros(GRID.shape, dtype=object),
        np.zeros(GRID.shape, dtype=bool),
        np.full(GRID.shape, "1"),
    ],
    ids=["complex", "object", "bool", "text"],
)
def test_non_numeric_heights_are_rejected(heights):
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        HeightMap(GRID, heights)


def test_heights_are_read_only():
    heights = np.zeros(GRID.shape)
    made = HeightMap(GRID, heights)
    heights[0, 0] = 1.0
    assert made.heights[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        made.heights[0, 0] = 1.0


@pytest.mark.parametrize("value", [math.nan, math.inf, "1", None, True])
def test_georeference_with_nan_is_rejected(value):
    with raises_terrain_error(TerrainErrorCode.GEOREFERENCE):
        Georeference("EPSG:32633", value, 0.0)


def test_crs_that_is_not_text_is_rejected():
    with raises_terrain_error(TerrainErrorCode.GEOREFERENCE):
        Georeference(32633, 0.0, 0.0)  # type: ignore[arg-type]


def test_crop_keeps_the_coordinates_of_every_height():
    whole = ground()
    piece = whole.cropped(1, 2, 3, 4)
    row, col = 2, 1
    assert piece.heights[row, col] == whole.heights[row + 1, col + 2]
    for part, r, c in ((whole, row + 1, col + 2), (piece, row, col)):
        assert part.georeference is not None
        assert part.georeference.easting + part.grid.x(r) == 499_999.5
        assert part.georeference.northing + part.grid.y(c) == 5_200_000.0


@pytest.mark.parametrize("piece", [(-1, 0, 3, 3), (0, 0, 6, 3), (0, 5, 3, 3), (0, 0, 1, 3)])
def test_crop_beyond_the_map_is_rejected(piece):
    with raises_terrain_error(TerrainErrorCode.OFF_MAP):
        ground().cropped(*piece)


def test_resampling_onto_the_same_grid_is_exact():
    grid = Grid(33, 40, 0.1)
    whole = ground(grid=grid)
    assert np.array_equal(whole.resampled(33, 40, 0.1).heights, whole.heights)


@given(
    rows=st.integers(2, 30),
    cols=st.integers(2, 30),
    cell=st.floats(0.01, 0.1),
    angle=st.floats(0.0, 1.2),
    direction=st.floats(-math.pi, math.pi),
)
def test_resampling_keeps_a_plane(rows, cols, cell, angle, direction):
    plane = slope(Grid(8, 9, 0.5), angle, direction).resampled(rows, cols, cell)
    expected = slope(Grid(rows, cols, cell), angle, direction)
    np.testing.assert_allclose(plane.heights, expected.heights, atol=1e-9)


def test_resampling_is_bilinear_between_grid_points():
    whole = HeightMap(Grid(2, 2, 1.0), np.array([[4.0, 0.0], [0.0, 0.0]]))
    fine = whole.resampled(3, 3, 0.5).heights
    assert np.array_equal(fine, [[4.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 0.0]])


def test_resampling_keeps_the_georeference():
    assert ground().resampled(4, 4, 0.3).georeference == PLACE


def test_resampling_reaches_the_outer_grid_points():
    fine = ground().resampled(9, 13, 0.25)
    assert fine.heights[-1, -1] == ground().heights[-1, -1]


@pytest.mark.parametrize("wider", [(6, 7, 0.5), (5, 8, 0.5), (5, 7, 0.501)])
def test_resampling_beyond_the_outer_grid_points_is_rejected(wider):
    with raises_terrain_error(TerrainErrorCode.OFF_MAP):
        ground().resampled(*wider)


def test_other_spacing_keeps_heights_and_drops_the_georeference():
    stretched = ground().with_cell(2.0)
    assert np.array_equal(stretched.heights, ground().heights)
    assert stretched.grid == Grid(5, 7, 2.0)
    assert stretched.georeference is None


@pytest.mark.parametrize("cell", [0.0, -1.0, math.nan, math.inf])
def test_invalid_spacing_is_rejected(cell):
    with pytest.raises(ParameterError, match="give a spacing"):
        ground().with_cell(cell)


@given(relief=st.floats(0.0, 1000.0))
def test_scaled_relief_has_the_requested_range_and_the_same_mean(relief):
    scaled = ground().with_relief(relief)
    assert scaled.relief == pytest.approx(relief, abs=1e-9)
    assert scaled.heights.mean() == pytest.approx(ground().heights.mean(), abs=1e-9)


def test_scaled_terrain_has_no_georeference():
    assert ground().with_relief(1.0).georeference is None


def test_relief_of_level_ground_cannot_be_scaled():
    with raises_terrain_error(TerrainErrorCode.ARGUMENT):
        HeightMap(GRID, np.zeros(GRID.shape)).with_relief(1.0)


@pytest.mark.parametrize("relief", [-1.0, math.nan, math.inf])
def test_invalid_relief_is_rejected(relief):
    with raises_terrain_error(TerrainErrorCode.ARGUMENT):
        ground().with_relief(relief)


@pytest.mark.parametrize("direction", [0.0, math.pi / 4, math.pi / 2, -math.pi / 4])
def test_steepest_slope_is_that_of_a_plane_toward_a_neighbour(direction):
    plane = slope(GRID, math.radians(33.0), direction)
    assert plane.max_slope == pytest.approx(math.radians(33.0))


@given(angle=st.floats(0.01, 1.5), seed=st.integers(0, 100))
def test_slopes_between_neighbours_are_limited(angle, seed):
    assert ground(seed).with_slope_limit(angle).max_slope <= angle


def test_steeper_terrain_has_the_slope_limit():
    assert ground().with_slope_limit(0.2).max_slope == pytest.approx(0.2)


def test_terrain_below_the_slope_limit_is_unchanged():
    gentle = ground().with_slope_limit(0.2)
    assert gentle.with_slope_limit(0.3) is gentle


@pytest.mark.parametrize("angle", [0.0, -0.1, math.pi / 2, math.nan])
def test_invalid_slope_limit_is_rejected(angle):
    with raises_terrain_error(TerrainErrorCode.ARGUMENT):
        ground().with_slope_limit(angle)


def test_terrain_with_raised_datum_keeps_its_elevations():
    with_datum_raised = ground().with_datum_raised(0.5)
    np.testing.assert_allclose(with_datum_raised.heights, ground().heights - 0.5)
    np.testing.assert_allclose(with_datum_raised.elevations, ground().elevations)
