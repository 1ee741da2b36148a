"""Cut and fill against a design: known volumes, and incremental updates without drift."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from support.design_scenes import GRID, level, pit

from msg_bridge.contract.grid import Grid
from soil_sim.errors import SoilError
from soil_sim.site.cut_fill import CutFill, compare_to_design
from soil_sim.site.design import DesignSurface
from soil_sim.terrain import slope


def are_equal(first: CutFill, second: CutFill) -> bool:
    """Return whether volumes and differences are equal to the last bit."""
    return (
        (first.cut_mm3, first.fill_mm3, first.within_tolerance)
        == (second.cut_mm3, second.fill_mm3, second.within_tolerance)
    ) and np.array_equal(first.difference, second.difference, equal_nan=True)


def test_cut_of_a_pit_is_its_volume():
    result = compare_to_design(DesignSurface(GRID, pit()), level())
    assert (result.cut, result.fill, result.remaining) == (3.0, 0.0, 3.0)


def test_fill_of_a_pit_is_its_volume():
    result = compare_to_design(DesignSurface(GRID, level()), pit())
    assert (result.cut, result.fill, result.remaining) == (0.0, 3.0, 3.0)


def test_cut_and_fill_do_not_cancel():
    design = pit()
    design[30:35, 5:20] = 1.0
    result = compare_to_design(DesignSurface(GRID, design), level())
    assert (result.cut, result.fill, result.remaining) == (3.0, 3.0, 6.0)


def test_inclined_design_through_level_ground_has_equal_cut_and_fill():
    grid = Grid(100, 50, 0.1)
    design = slope(grid, np.arctan(0.2), 0.0).heights
    result = compare_to_design(DesignSurface(grid, design), level(grid))
    # Two wedges, each half the map long and 0.2 * 5 m high at its end.
    assert result.cut == pytest.approx(0.5 * 5.0 * 1.0 * 5.0, abs=1e-6)
    assert result.fill == pytest.approx(result.cut, abs=1e-6)


def test_cells_without_design_are_not_counted():
    design = level(height=np.nan)
    design[0, :10] = -1.0
    ground = level(height=3.0)
    ground[0, :10] = -1.0
    result = compare_to_design(DesignSurface(GRID, design), ground)
    assert (result.remaining, result.within_tolerance, result.designed_cells) == (0.0, 1.0, 10)
    assert np.array_equal(np.isnan(result.difference), np.isnan(design))


def test_difference_is_elevation_minus_design():
    result = compare_to_design(DesignSurface(GRID, pit()), level(height=0.25))
    assert result.difference.dtype == np.float32
    assert np.array_equal(result.difference, 0.25 - pit())
    with pytest.raises(ValueError, match="read-only"):
        result.difference[0, 0] = 1.0


def test_difference_equal_to_the_tolerance_is_within_it():
    # In float64 1.05 - 1.0 is more than 0.05.
    ground = level(height=1.05)
    ground[:10] = 1.0501
    ground[10:20] = 0.95
    ground[20:30] = 0.9499
    result = compare_to_design(DesignSurface(GRID, level(height=1.0)), ground, tolerance=0.05)
    assert result.within_tolerance == 0.5


def test_zero_tolerance_requires_the_exact_design_height():
    ground = level()
    ground[0] = 0.001
    assert (
        compare_to_design(DesignSurface(GRID, level()), ground, tolerance=0.0).within_tolerance
        == 39 / 40
    )


SMALL = Grid(4, 5, 0.3)
HEIGHTS = st.floats(-20.0, 20.0)


@settings(max_examples=60, deadline=None)
@given(
    design=npst.arrays(np.float64, SMALL.shape, elements=st.one_of(HEIGHTS, st.just(np.nan))),
    ground=npst.arrays(np.float64, SMALL.shape, elements=HEIGHTS),
    steps=st.lists(
        st.lists(st.tuples(st.integers(0, 3), st.integers(0, 4), HEIGHTS), max_size=8), max_size=5
    ),
)
def test_incremental_updates_equal_a_full_comparison_exactly(design, ground, steps):
    design[0, 0] = 0.0
    surface = DesignSurface(SMALL, design)
    updated = compare_to_design(surface, ground, tolerance=1.0)
    for step in steps:
        rows = np.array([row for row, _, _ in step], dtype=np.intp)
        cols = np.array([col for _, col, _ in step], dtype=np.intp)
        heights = np.array([height for _, _, height in step])
        updated.update(rows, cols, heights)
        for row, col, height in step:
            ground[row, col] = height
        assert are_equal(updated, compare_to_design(surface, ground, tolerance=1.0))
    assert updated.cut - updated.fill == pytest.approx(np.nansum(ground - design) * 0.09, abs=1e-7)


@pytest.mark.parametrize(
    ("rows", "cols", "heights"),
    [
        ([0], [0], [np.nan]),
        ([0, 1], [0, 1], [0.0, np.inf]),
        ([0, 1], [0], [0.0]),
        ([0], [0], [[0.0]]),
        ([-1], [0], [0.0]),
        ([40], [0], [0.0]),
        ([0], [30], [0.0]),
        ([0.5], [0], [0.0]),
        ([0], [0], [1e15]),
    ],
)
def test_invalid_update_is_rejected_and_changes_nothing(rows, cols, heights):
    surface = DesignSurface(GRID, pit())
    result = compare_to_design(surface, level())
    with pytest.raises(SoilError):
        result.update(np.array(rows), np.array(cols), heights)
    assert are_equal(result, compare_to_design(surface, level()))


def test_empty_update_changes_nothing():
    result = compare_to_design(DesignSurface(GRID, pit()), level())
    result.update(np.array([], dtype=int), np.array([], dtype=int), [])
    assert result.cut == 3.0


@pytest.mark.parametrize("tolerance", [-0.1, np.nan, np.inf])
def test_invalid_tolerance_is_rejected(tolerance):
    with pytest.raises(SoilError, match="tolerance"):
        compare_to_design(DesignSurface(GRID, pit()), level(), tolerance=tolerance)


def test_terrain_of_another_shape_is_rejected():
    with pytest.raises(SoilError):
        compare_to_design(DesignSurface(GRID, pit()), level().T)


def test_terrain_with_nan_is_rejected():
    with pytest.raises(SoilError):
        compare_to_design(DesignSurface(GRID, pit()), level(height=np.nan))
