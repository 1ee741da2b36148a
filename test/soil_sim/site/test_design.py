"""Cut and fill against a design: known volumes, and incremental updates without drift."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from msg_bridge.contract.grid import Grid
from soil_sim.errors import SoilError, TerrainError
from soil_sim.site.design import CutFill, DesignSurface, compare_to_design, load_design
from soil_sim.terrain import SUFFIXES, Georeference, HeightMap, save_terrain, slope

GRID = Grid(40, 30, 0.2)
PLACE = Georeference("EPSG:32633", 500_000.0, 5_200_000.0, elevation=400.0)


def level(grid=GRID, height=0.0):
    return np.full(grid.shape, height)


def pit():
    """Return level ground with a pit 2 m x 3 m x 0.5 m."""
    heights = level()
    heights[10:20, 5:20] = -0.5
    return heights


def same(one: CutFill, other: CutFill) -> bool:
    return (
        (one.cut_mm3, one.fill_mm3, one.within_tolerance)
        == (other.cut_mm3, other.fill_mm3, other.within_tolerance)
    ) and np.array_equal(one.difference, other.difference, equal_nan=True)


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
    followed = compare_to_design(surface, ground, tolerance=1.0)
    for step in steps:
        rows = np.array([row for row, _, _ in step], dtype=np.intp)
        cols = np.array([col for _, col, _ in step], dtype=np.intp)
        heights = np.array([height for _, _, height in step])
        followed.update(rows, cols, heights)
        for row, col, height in step:
            ground[row, col] = height
        assert same(followed, compare_to_design(surface, ground, tolerance=1.0))
    assert followed.cut - followed.fill == pytest.approx(
        np.nansum(ground - design) * 0.09, abs=1e-7
    )


@pytest.mark.parametrize(
    ("rows", "cols", "heights", "why"),
    [
        ([0], [0], [np.nan], "1 elevations are not finite"),
        ([0, 1], [0, 1], [0.0, np.inf], "1 elevations are not finite"),
        ([0, 1], [0], [0.0], "give one of each"),
        ([0], [0], [[0.0]], "give one of each"),
        ([-1], [0], [0.0], "outside of the map"),
        ([40], [0], [0.0], "rows 0 to 39"),
        ([0], [30], [0.0], "cols 0 to 29"),
        ([0.5], [0], [0.0], "give integers"),
        ([0], [0], [1e15], "too much to sum"),
    ],
)
def test_invalid_update_is_rejected_and_changes_nothing(rows, cols, heights, why):
    surface = DesignSurface(GRID, pit())
    result = compare_to_design(surface, level())
    with pytest.raises(SoilError, match=why):
        result.update(np.array(rows), np.array(cols), heights)
    assert same(result, compare_to_design(surface, level()))


def test_empty_update_changes_nothing():
    result = compare_to_design(DesignSurface(GRID, pit()), level())
    result.update(np.array([], dtype=int), np.array([], dtype=int), [])
    assert result.cut == 3.0


@pytest.mark.parametrize("tolerance", [-0.1, np.nan, np.inf])
def test_invalid_tolerance_is_rejected(tolerance):
    with pytest.raises(SoilError, match="tolerance is"):
        compare_to_design(DesignSurface(GRID, pit()), level(), tolerance=tolerance)


def test_terrain_of_another_shape_is_rejected():
    with pytest.raises(SoilError, match=r"shape \(30, 40\), the design \(40, 30\)"):
        compare_to_design(DesignSurface(GRID, pit()), level().T)


def test_terrain_with_nan_is_rejected():
    with pytest.raises(SoilError, match="1200 elevations are not finite"):
        compare_to_design(DesignSurface(GRID, pit()), level(height=np.nan))


def test_design_of_another_shape_is_rejected():
    with pytest.raises(SoilError, match=r"shape \(30, 40\), the terrain \(40, 30\)"):
        DesignSurface(GRID, level().T)


@pytest.mark.parametrize("bad", [-9999.0, np.inf, 1e20])
def test_nodata_value_is_not_a_design_height(bad):
    heights = pit()
    heights[3, 4] = bad
    with pytest.raises(SoilError, match="at row 3, col 4; give NaN"):
        DesignSurface(GRID, heights)


def test_design_without_any_height_is_rejected():
    with pytest.raises(SoilError, match="no height in any cell"):
        DesignSurface(GRID, level(height=np.nan))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_design_is_read_from_any_terrain_file(tmp_path, suffix):
    save_terrain(tmp_path / f"pit{suffix}", HeightMap(GRID, pit()))
    cell = 0.2 if suffix == ".npy" else None
    design = load_design(tmp_path / f"pit{suffix}", GRID, cell=cell)
    assert np.array_equal(design.heights, pit())


def test_cells_with_nodata_have_no_design(tmp_path):
    (tmp_path / "pad.asc").write_text(
        "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 0.5\n1 -9999 1\n2 2 0\n"
    )
    design = load_design(tmp_path / "pad.asc", Grid(3, 2, 0.5))
    assert np.array_equal(design.heights, [[1, 0], [np.nan, 2], [1, 2]], equal_nan=True)
    np.save(tmp_path / "pad.npy", design.heights)
    again = load_design(tmp_path / "pad.npy", Grid(3, 2, 0.5), cell=0.5)
    assert np.array_equal(again.heights, design.heights, equal_nan=True)


@pytest.mark.parametrize("cell", [0.1, 0.25, 1.0])
def test_plane_of_another_spacing_is_resampled_exactly(tmp_path, cell):
    coarse = Grid(int(10 / cell) + 1, int(9 / cell) + 1, cell)
    save_terrain(tmp_path / "ramp.npz", slope(coarse, 0.3, 0.7))
    design = load_design(tmp_path / "ramp.npz", GRID)
    np.testing.assert_allclose(design.heights, slope(GRID, 0.3, 0.7).heights, atol=1e-12)


def test_terrain_beyond_a_smaller_design_has_no_design(tmp_path):
    save_terrain(tmp_path / "pad.npz", HeightMap(Grid(5, 4, 0.4), np.ones((5, 4))))
    design = load_design(tmp_path / "pad.npz", GRID)
    # 2 m x 1.6 m in cells of 0.2 m, centred.
    rows, cols = np.nonzero(design.has_design)
    assert (rows.min(), rows.max(), cols.min(), cols.max()) == (15, 24, 11, 18)
    assert design.has_design.sum() == 10 * 8
    assert np.nanmin(design.heights) == np.nanmax(design.heights) == 1.0


@pytest.mark.parametrize("suffix", [".npz", ".tif"])
def test_design_is_positioned_by_its_georeference_and_datum(tmp_path, suffix):
    pad = HeightMap(Grid(2, 2, 0.2), np.ones((2, 2)), PLACE.translated(1.0, -2.0, 0.5))
    save_terrain(tmp_path / f"pad{suffix}", pad)
    design = load_design(tmp_path / f"pad{suffix}", GRID, georeference=PLACE)
    rows, cols = np.nonzero(design.has_design)
    assert GRID.x(rows).mean() == pytest.approx(1.0)
    assert GRID.y(cols).mean() == pytest.approx(-2.0)
    np.testing.assert_allclose(design.heights[design.has_design], 1.5)
    assert len(rows) == 4


def test_design_without_georeference_is_centred(tmp_path):
    pad = HeightMap(Grid(2, 2, 0.2), np.ones((2, 2)), PLACE.translated(1.0, -2.0))
    save_terrain(tmp_path / "pad.npz", pad)
    design = load_design(tmp_path / "pad.npz", GRID)
    assert np.nanmean(design.heights) == 1.0
    assert design.has_design[19:21, 14:16].all()


def test_design_that_does_not_overlap_the_terrain_is_rejected(tmp_path):
    pad = HeightMap(Grid(2, 2, 0.2), np.ones((2, 2)), PLACE.translated(0.0, 4000.0))
    save_terrain(tmp_path / "pad.tif", pad)
    with pytest.raises(TerrainError, match=r"pad\.tif: .*4000 m north .* no height on the terrain"):
        load_design(tmp_path / "pad.tif", GRID, georeference=PLACE)


def test_design_in_another_crs_is_rejected(tmp_path):
    save_terrain(tmp_path / "pit.tif", HeightMap(GRID, pit(), PLACE))
    other = Georeference("EPSG:32632", PLACE.easting, PLACE.northing)
    with pytest.raises(TerrainError, match="reproject it"):
        load_design(tmp_path / "pit.tif", GRID, georeference=other)


def test_equivalent_crs_definitions_are_equal(tmp_path):
    save_terrain(tmp_path / "pit.tif", HeightMap(GRID, pit(), PLACE))
    named = Georeference("epsg:32633", PLACE.easting, PLACE.northing, PLACE.elevation)
    design = load_design(tmp_path / "pit.tif", GRID, georeference=named)
    np.testing.assert_allclose(design.heights, pit(), atol=1e-12)


def test_resampling_does_not_extrapolate_into_cells_without_design(tmp_path):
    heights = pit()
    heights[0, 0] = np.nan
    np.save(tmp_path / "pit.npy", heights)
    fine = Grid(79, 59, 0.1)  # every second point is a point of the file
    design = load_design(tmp_path / "pit.npy", fine, cell=0.2)
    assert np.array_equal(design.heights[::2, ::2], heights, equal_nan=True)
    assert np.isnan(design.heights).sum() == 4


def test_undeclared_nodata_value_in_a_design_is_rejected(tmp_path):
    heights = pit()
    heights[0, 0] = -9999.0
    np.save(tmp_path / "pit.npy", heights)
    with pytest.raises(TerrainError, match=r"pit\.npy: 1 design heights are beyond"):
        load_design(tmp_path / "pit.npy", Grid(80, 60, 0.1), cell=0.2)
