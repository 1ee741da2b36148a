"""Terrain files of every kind: terrain round-trips, and invalid files are rejected."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain import SUFFIXES, Georeference, HeightMap, load_terrain, save_terrain

GRID = Grid(5, 7, 0.5)
HEIGHTS = np.random.default_rng(0).normal(size=GRID.shape)
PLACE = Georeference("EPSG:32633", 500_000.25, 5_200_000.0)
STATES_SPACING = [suffix for suffix in SUFFIXES if suffix != ".npy"]
EXACT = [suffix for suffix in SUFFIXES if suffix != ".png"]


def saved(folder: Path, suffix: str, place: Georeference | None = PLACE) -> Path:
    path = folder / f"site{suffix}"
    save_terrain(path, HeightMap(GRID, HEIGHTS, place))
    return path


def cell_for(path: Path) -> float | None:
    return GRID.cell if path.suffix == ".npy" else None


@pytest.mark.parametrize("suffix", EXACT)
def test_heights_round_trip_exactly(tmp_path, suffix):
    path = saved(tmp_path, suffix)
    assert np.array_equal(load_terrain(path, cell=cell_for(path)).heights, HEIGHTS)


@pytest.mark.parametrize("suffix", STATES_SPACING)
def test_grid_round_trips(tmp_path, suffix):
    assert load_terrain(saved(tmp_path, suffix)).grid == GRID


@pytest.mark.parametrize("suffix", [".npz", ".png", ".tif", ".tiff"])
def test_georeference_round_trips(tmp_path, suffix):
    assert load_terrain(saved(tmp_path, suffix)).georeference == PLACE


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_terrain_without_georeference_round_trips(tmp_path, suffix):
    path = saved(tmp_path, suffix, place=None)
    assert load_terrain(path, cell=cell_for(path)).georeference is None


@pytest.mark.parametrize("suffix", STATES_SPACING)
def test_elevations_above_a_datum_round_trip(tmp_path, suffix):
    path = tmp_path / f"site{suffix}"
    high = HeightMap(GRID, HEIGHTS, Georeference("EPSG:32633", 0.0, 9.0, elevation=800.0))
    save_terrain(path, high)
    np.testing.assert_allclose(load_terrain(path).elevations, high.elevations, atol=1e-4)


@pytest.mark.parametrize("second", SUFFIXES)
@pytest.mark.parametrize("first", SUFFIXES)
def test_conversion_between_formats_keeps_heights_cell_and_georeference(tmp_path, first, second):
    path = saved(tmp_path, first)
    loaded = load_terrain(path, cell=cell_for(path))
    again = tmp_path / f"again{second}"
    save_terrain(again, loaded)
    back = load_terrain(again, cell=cell_for(again))
    level = np.ptp(HEIGHTS) / 65535
    atol = 0.5001 * level if second == ".png" else 0.0
    assert back.grid == loaded.grid
    np.testing.assert_allclose(back.heights, loaded.heights, rtol=0, atol=atol)
    place = loaded.georeference
    if place is not None and second == ".asc":
        place = dataclasses.replace(place, crs="")
    assert back.georeference == (None if second == ".npy" else place)


@pytest.mark.parametrize("suffix", [".npz", ".png", ".tif", ".tiff"])
def test_datum_round_trips(tmp_path, suffix):
    path = tmp_path / f"site{suffix}"
    high = HeightMap(GRID, HEIGHTS, Georeference("EPSG:32633", 0.0, 9.0, elevation=800.1))
    save_terrain(path, high)
    back = load_terrain(path)
    assert back.georeference == high.georeference
    atol = 0.5001 * np.ptp(HEIGHTS) / 65535 if suffix == ".png" else 1e-12
    np.testing.assert_allclose(back.heights, HEIGHTS, rtol=0, atol=atol)


def test_ascii_grid_above_a_datum_stores_elevations(tmp_path):
    place = Georeference("", 0.0, 9.0, elevation=800.0)
    save_terrain(tmp_path / "site.asc", HeightMap(GRID, HEIGHTS, place))
    back = load_terrain(tmp_path / "site.asc")
    assert back.georeference == Georeference("", 0.0, 9.0)
    assert np.array_equal(back.heights, HEIGHTS + 800.0)


@pytest.mark.parametrize("suffix", [".asc", ".tif", ".tiff"])
def test_elevations_beyond_the_height_limit_are_rejected_when_saving(tmp_path, suffix):
    place = Georeference("", 0.0, 9.0, elevation=-9999.0)
    with raises_terrain_error(TerrainErrorCode.HEIGHT):
        save_terrain(tmp_path / f"site{suffix}", HeightMap(GRID, 0.0 * HEIGHTS, place))
    assert not list(tmp_path.iterdir())


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    data=st.data(),
    suffix=st.sampled_from(SUFFIXES),
    shape=st.tuples(st.integers(2, 4), st.integers(2, 4)),
    cell=st.floats(0.01, 1000.0),
    easting=st.floats(1e5, 1e6),
    northing=st.floats(1e5, 1e7),
)
def test_any_map_round_trips(tmp_path, data, suffix, shape, cell, easting, northing):
    count = shape[0] * shape[1]
    heights = data.draw(st.lists(st.floats(-9000.0, 9000.0), min_size=count, max_size=count))
    made = HeightMap(
        Grid(*shape, cell), np.reshape(heights, shape), Georeference("", easting, northing)
    )
    path = tmp_path / f"site{suffix}"
    save_terrain(path, made)
    back = load_terrain(path, cell=cell if suffix == ".npy" else None)
    assert back.grid == made.grid
    atol = 0.5001 * made.relief / 65535 if suffix == ".png" else 0.0
    np.testing.assert_allclose(back.heights, made.heights, rtol=1e-15, atol=atol)
    if suffix != ".npy":
        assert back.georeference.easting == pytest.approx(easting, abs=1e-8)
        assert back.georeference.northing == pytest.approx(northing, abs=1e-8)


@pytest.mark.parametrize("suffix", STATES_SPACING)
def test_other_cell_size_stretches_the_terrain_and_drops_its_georeference(tmp_path, suffix):
    stretched = load_terrain(saved(tmp_path, suffix), cell=2.0)
    assert stretched.grid == Grid(5, 7, 2.0)
    assert stretched.georeference is None


def test_equal_cell_size_keeps_the_georeference(tmp_path):
    assert load_terrain(saved(tmp_path, ".tif"), cell=0.5).georeference == PLACE


@pytest.mark.parametrize("suffix", EXACT)
def test_vertical_scale_converts_feet_to_metres(tmp_path, suffix):
    path = saved(tmp_path, suffix)
    scaled = load_terrain(path, cell=cell_for(path), vertical_scale=0.3048)
    assert np.array_equal(scaled.heights, HEIGHTS * 0.3048)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_suffix_is_case_insensitive(tmp_path, suffix):
    path = saved(tmp_path, suffix.upper())
    assert path.exists()
    load_terrain(path, cell=0.5)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_file_is_named(tmp_path, suffix):
    with raises_terrain_error(
        TerrainErrorCode.NO_FILE, match=rf"nowhere\{suffix}: there is no such file"
    ):
        load_terrain(tmp_path / f"nowhere{suffix}", cell=0.5)


def test_folder_instead_of_a_file_is_rejected(tmp_path):
    (tmp_path / "site.npz").mkdir()
    with raises_terrain_error(TerrainErrorCode.NO_FILE):
        load_terrain(tmp_path / "site.npz")


@pytest.mark.parametrize("name", ["site.obj", "site", "site.npz.bak"])
def test_unknown_suffix_is_rejected(tmp_path, name):
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        load_terrain(tmp_path / name)
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        save_terrain(tmp_path / name, HeightMap(GRID, HEIGHTS))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("cell", [0.0, -0.2, float("nan"), float("inf"), "0.2", True])
def test_invalid_cell_size_is_rejected(tmp_path, suffix, cell):
    with raises_terrain_error(TerrainErrorCode.CELL_SIZE):
        load_terrain(saved(tmp_path, suffix), cell=cell)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_invalid_vertical_scale_is_rejected(tmp_path, scale):
    with raises_terrain_error(TerrainErrorCode.ARGUMENT):
        load_terrain(saved(tmp_path, ".npz"), vertical_scale=scale)


@pytest.mark.parametrize("suffix", EXACT)
def test_height_range_is_rejected_for_formats_without_it(tmp_path, suffix):
    with raises_terrain_error(TerrainErrorCode.ARGUMENT):
        load_terrain(saved(tmp_path, suffix), cell=0.5, height_range=(0.0, 1.0))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_folder_is_rejected(tmp_path, suffix):
    with raises_terrain_error(TerrainErrorCode.UNWRITABLE):
        saved(tmp_path / "nowhere", suffix)


def test_failed_save_keeps_the_old_file_and_leaves_no_temporary_file(tmp_path):
    path = saved(tmp_path, ".tif")
    before = path.read_bytes()
    with raises_terrain_error(TerrainErrorCode.GEOREFERENCE):
        save_terrain(path, HeightMap(GRID, HEIGHTS, Georeference("nonsense", 0.0, 0.0)))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_save_to_a_folder_is_rejected_and_leaves_no_temporary_file(tmp_path, suffix):
    folder = tmp_path / f"site{suffix}"
    folder.mkdir()
    with raises_terrain_error(TerrainErrorCode.UNWRITABLE):
        saved(tmp_path, suffix)
    assert list(tmp_path.iterdir()) == [folder]


def damage_codes(suffix):
    """Return the possible codes of a truncated file; an ASCII grid may lack any of its lines."""
    codes = {TerrainErrorCode.INVALID_FILE}
    if suffix == ".asc":
        codes |= {TerrainErrorCode.KEYS, TerrainErrorCode.SHAPE, TerrainErrorCode.CELL_SIZE}
    return codes


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_empty_file_is_rejected(tmp_path, suffix):
    path = tmp_path / f"site{suffix}"
    path.touch()
    with raises_terrain_error(*damage_codes(suffix)):
        load_terrain(path, cell=0.5)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(part=st.floats(0.0, 0.9))
def test_truncated_file_is_rejected(tmp_path, suffix, part):
    path = saved(tmp_path, suffix)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    with raises_terrain_error(*damage_codes(suffix)):
        load_terrain(path, cell=0.5)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_corrupted_file_is_read_or_raises_terrain_error(tmp_path, suffix, data):
    path = saved(tmp_path, suffix)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    try:
        loaded = load_terrain(path, cell=0.5)
    except TerrainError:
        return
    assert np.isfinite(loaded.heights).all()
