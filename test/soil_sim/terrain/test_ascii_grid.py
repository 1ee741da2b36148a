"""ESRI ASCII grids: parsing is strict, and every error names the line or the key."""

import numpy as np
import pytest
import rasterio
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainErrorCode
from soil_sim.terrain import Georeference, HeightMap, load_terrain, save_terrain, to_north_up

HEADER = {
    "ncols": "3",
    "nrows": "2",
    "xllcorner": "100.0",
    "yllcorner": "200.0",
    "cellsize": "2.0",
    "NODATA_value": "-9999",
}
ROWS = ("1 2 3", "4 5 6.5")


def asc(folder, rows=ROWS, drop=(), **changes):
    keys = {key: value for key, value in {**HEADER, **changes}.items() if key not in drop}
    path = folder / "site.asc"
    path.write_text("\n".join([*(f"{k} {v}" for k, v in keys.items()), *rows]) + "\n")
    return path


def test_grid_is_read_north_up(tmp_path):
    loaded = load_terrain(asc(tmp_path))
    assert loaded.grid == Grid(3, 2, 2.0)
    assert np.array_equal(loaded.heights, [[3.0, 6.5], [2.0, 5.0], [1.0, 4.0]])


def test_georeference_of_a_corner_is_converted_to_the_centre(tmp_path):
    assert load_terrain(asc(tmp_path)).georeference == Georeference("", 103.0, 202.0)


def test_georeference_of_a_cell_centre_is_converted_to_the_map_centre(tmp_path):
    path = asc(tmp_path, drop=("xllcorner", "yllcorner"), xllcenter="101.0", yllcenter="201.0")
    assert load_terrain(path).georeference == Georeference("", 103.0, 202.0)


def test_upper_case_keys_exponents_and_blank_lines_are_accepted(tmp_path):
    path = asc(tmp_path, rows=("", "1e0 2 +3", "4 5 65e-1", ""), drop=("ncols",), NCOLS="3")
    assert load_terrain(path).heights[0, 1] == 6.5


@pytest.mark.parametrize("key", ["ncols", "nrows", "xllcorner", "yllcorner", "cellsize"])
def test_missing_key_is_rejected(tmp_path, key):
    with raises_terrain_error(TerrainErrorCode.KEYS):
        load_terrain(asc(tmp_path, drop=(key,)))


@pytest.mark.parametrize("key", ["dx", "nan_value", "sizecell"])
def test_unknown_key_is_rejected(tmp_path, key):
    with raises_terrain_error(TerrainErrorCode.KEYS):
        load_terrain(asc(tmp_path, **{key: "1"}))


def test_duplicate_key_is_rejected(tmp_path):
    with raises_terrain_error(TerrainErrorCode.KEYS):
        load_terrain(asc(tmp_path, NCOLS="3"))


def test_corner_and_center_keys_together_are_rejected(tmp_path):
    with raises_terrain_error(TerrainErrorCode.KEYS):
        load_terrain(asc(tmp_path, xllcenter="1"))


@pytest.mark.parametrize(
    ("value", "code"),
    [
        ("0", TerrainErrorCode.SHAPE),
        ("-1", TerrainErrorCode.SHAPE),
        ("1", TerrainErrorCode.SHAPE),
        ("2.5", TerrainErrorCode.SHAPE),
        ("x", TerrainErrorCode.INVALID_FILE),
        ("nan", TerrainErrorCode.INVALID_FILE),
        ("", TerrainErrorCode.KEYS),
    ],
)
def test_invalid_number_of_rows_or_columns_is_rejected(tmp_path, value, code):
    with raises_terrain_error(code):
        load_terrain(asc(tmp_path, ncols=value))


@pytest.mark.parametrize(
    ("value", "code"),
    [
        ("0", TerrainErrorCode.CELL_SIZE),
        ("-2", TerrainErrorCode.CELL_SIZE),
        ("nan", TerrainErrorCode.INVALID_FILE),
        ("inf", TerrainErrorCode.INVALID_FILE),
        ("two", TerrainErrorCode.INVALID_FILE),
        ("2,0", TerrainErrorCode.INVALID_FILE),
    ],
)
def test_invalid_cellsize_is_rejected(tmp_path, value, code):
    with raises_terrain_error(code):
        load_terrain(asc(tmp_path, cellsize=value))


@pytest.mark.parametrize("rows", [("1 2 3", "4 5"), ("1 2 3", "4 5 6 7"), ("1", "2")])
def test_row_of_wrong_length_is_rejected(tmp_path, rows):
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(asc(tmp_path, rows=rows))


@pytest.mark.parametrize("rows", [(), ("1 2 3",), ("1 2 3",) * 3])
def test_wrong_number_of_rows_is_rejected(tmp_path, rows):
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(asc(tmp_path, rows=rows))


@pytest.mark.parametrize("word", ["x", "nan", "NaN", "inf", "-inf", "1,5", "1_0", "0x1", "1e999"])
@pytest.mark.parametrize("column", [0, 1])
def test_non_numeric_height_is_rejected(tmp_path, word, column):
    words = ["4", "5", "6"]
    words[column] = word
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(asc(tmp_path, rows=("1 2 3", " ".join(words))))


def test_error_of_a_cell_without_height_has_its_position(tmp_path):
    with raises_terrain_error(
        TerrainErrorCode.HEIGHT, match="line 8, value 2 is -5, the nodata value; 1 of 6 cells"
    ):
        load_terrain(asc(tmp_path, rows=("1 2 3", "4 -5.0 6"), NODATA_value="-5"))


def test_default_nodata_value_is_minus_9999(tmp_path):
    with raises_terrain_error(TerrainErrorCode.HEIGHT):
        load_terrain(asc(tmp_path, rows=("1 2 -9999", "4 5 6"), drop=("NODATA_value",)))


def test_binary_file_is_rejected(tmp_path):
    (tmp_path / "site.asc").write_bytes(b"ncols 3\xff")
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(tmp_path / "site.asc")


def test_header_of_a_huge_grid_is_rejected_without_allocation(tmp_path):
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(asc(tmp_path, ncols="1000000000", nrows="1000000000"))


def test_gdal_reads_the_same_heights_from_a_saved_grid(tmp_path):
    heights = np.random.default_rng(0).normal(size=(4, 6))
    made = HeightMap(Grid(4, 6, 0.5), heights, Georeference("", 500_000.0, 5_200_000.0))
    save_terrain(tmp_path / "site.asc", made)
    with rasterio.open(tmp_path / "site.asc") as dataset:
        assert dataset.bounds == (499_999.0, 5_199_998.5, 500_001.0, 5_200_001.5)
        np.testing.assert_allclose(dataset.read(1), to_north_up(heights), rtol=1e-6)
