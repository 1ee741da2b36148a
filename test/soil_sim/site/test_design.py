"""Design surfaces: validation, and reading and resampling of design files."""

import numpy as np
import pytest
from support.design_scenes import GRID, level, pit
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainErrorCode
from soil_sim.site.design import DesignSurface, load_design
from soil_sim.terrain import SUFFIXES, Georeference, HeightMap, save_terrain, slope

PLACE = Georeference("EPSG:32633", 500_000.0, 5_200_000.0, elevation=400.0)


def test_design_of_another_shape_is_rejected():
    with raises_terrain_error(TerrainErrorCode.SHAPE):
        DesignSurface(GRID, level().T)


@pytest.mark.parametrize("bad", [-9999.0, np.inf, 1e20])
def test_nodata_value_is_not_a_design_height(bad):
    heights = pit()
    heights[3, 4] = bad
    with raises_terrain_error(TerrainErrorCode.HEIGHT):
        DesignSurface(GRID, heights)


def test_design_without_any_height_is_rejected():
    with raises_terrain_error(TerrainErrorCode.HEIGHT):
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
    with raises_terrain_error(
        TerrainErrorCode.OFF_MAP, match=r"pad\.tif: .*4000 m north .* no height on the terrain"
    ):
        load_design(tmp_path / "pad.tif", GRID, georeference=PLACE)


def test_design_in_another_crs_is_rejected(tmp_path):
    save_terrain(tmp_path / "pit.tif", HeightMap(GRID, pit(), PLACE))
    other = Georeference("EPSG:32632", PLACE.easting, PLACE.northing)
    with raises_terrain_error(TerrainErrorCode.GEOREFERENCE):
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
    with raises_terrain_error(TerrainErrorCode.HEIGHT):
        load_design(tmp_path / "pit.npy", Grid(80, 60, 0.1), cell=0.2)
