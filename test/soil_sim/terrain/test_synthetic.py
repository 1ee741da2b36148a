"""Synthetic terrain has the properties given by its parameters."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainErrorCode
from soil_sim.terrain import flat, rough, slope

GRID = Grid(40, 60, 0.2)


def test_flat_terrain_has_constant_height():
    assert (flat(GRID, 1.5).heights == 1.5).all()


def test_flat_terrain_at_nan_is_rejected():
    with raises_terrain_error(TerrainErrorCode.HEIGHT):
        flat(GRID, math.nan)


@given(angle=st.floats(0.0, 1.4), direction=st.floats(-math.pi, math.pi))
def test_slope_rises_by_its_angle_in_its_direction(angle, direction):
    plane = slope(GRID, angle, direction)
    dz_dx = (plane.heights[0, 0] - plane.heights[1, 0]) / GRID.cell
    dz_dy = (plane.heights[0, 0] - plane.heights[0, 1]) / GRID.cell
    assert dz_dx == pytest.approx(math.tan(angle) * math.cos(direction), abs=1e-9)
    assert dz_dy == pytest.approx(math.tan(angle) * math.sin(direction), abs=1e-9)


def test_slope_has_height_zero_at_the_centre():
    assert slope(Grid(5, 5, 1.0), 0.5, 0.3).heights[2, 2] == 0.0


@pytest.mark.parametrize("angle", [-0.1, math.pi / 2, math.nan])
def test_invalid_slope_is_rejected(angle):
    with raises_terrain_error(TerrainErrorCode.ARGUMENT):
        slope(GRID, angle, 0.0)


def test_slope_without_direction_is_rejected():
    with raises_terrain_error(TerrainErrorCode.ARGUMENT):
        slope(GRID, 0.1, math.inf)


@given(rms=st.floats(0.0, 10.0), length=st.floats(0.2, 8.0), seed=st.integers(0, 99))
def test_rough_terrain_has_zero_mean_and_the_given_rms(rms, length, seed):
    heights = rough(GRID, rms, length, np.random.default_rng(seed)).heights
    assert math.sqrt(np.mean(heights**2)) == pytest.approx(rms, abs=1e-12)
    assert heights.mean() == pytest.approx(0.0, abs=1e-9)


def test_rough_terrain_is_reproducible_by_its_seed():
    one, same, other = (
        rough(GRID, 1.0, 1.0, np.random.default_rng(seed)).heights for seed in (1, 1, 2)
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("distance", [0.5, 1.0, 1.5])
def test_rough_terrain_has_a_gaussian_autocorrelation(axis, distance):
    length = 2.0
    h = rough(Grid(600, 500, 0.25), 1.0, length, np.random.default_rng(5)).heights
    step = round(distance * length / 0.25)
    h = np.moveaxis(h, axis, 0)
    assert np.mean(h[step:] * h[:-step]) == pytest.approx(math.exp(-(distance**2)), abs=0.06)


def test_rough_terrain_is_not_periodic():
    rng = np.random.default_rng(7)
    edges = [rough(GRID, 1.0, 2.0, rng).heights[[0, -1]] for _ in range(200)]
    first, last = np.concatenate(edges, axis=1)
    assert abs(np.corrcoef(first, last)[0, 1]) < 0.15


@pytest.mark.parametrize("rms", [-1.0, math.nan, math.inf])
def test_invalid_roughness_is_rejected(rms):
    with raises_terrain_error(TerrainErrorCode.ARGUMENT):
        rough(GRID, rms, 1.0, np.random.default_rng(0))


@pytest.mark.parametrize("length", [0.0, 0.19, 8.1, math.nan])
def test_correlation_length_too_long_for_the_map_is_rejected(length):
    with raises_terrain_error(TerrainErrorCode.ARGUMENT, match="from a cell"):
        rough(GRID, 1.0, length, np.random.default_rng(0))
