"""Terrain files of every kind: what is saved comes back, and what cannot be ground is refused."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError
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
def test_heights_come_back_to_the_last_bit(tmp_path, suffix):
    path = saved(tmp_path, suffix)
    assert np.array_equal(load_terrain(path, cell=cell_for(path)).heights, HEIGHTS)


@pytest.mark.parametrize("suffix", STATES_SPACING)
def test_grid_comes_back(tmp_path, suffix):
    assert load_terrain(saved(tmp_path, suffix)).grid == GRID


@pytest.mark.parametrize("suffix", [".npz", ".png", ".tif", ".tiff"])
def test_georeference_comes_back(tmp_path, suffix):
    assert load_terrain(saved(tmp_path, suffix)).georeference == PLACE


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_ground_without_georeference_comes_back_without(tmp_path, suffix):
    path = saved(tmp_path, suffix, place=None)
    assert load_terrain(path, cell=cell_for(path)).georeference is None


@pytest.mark.parametrize("suffix", STATES_SPACING)
def test_elevations_come_back_from_a_map_above_its_datum(tmp_path, suffix):
    path = tmp_path / f"site{suffix}"
    high = HeightMap(GRID, HEIGHTS, Georeference("EPSG:32633", 0.0, 9.0, elevation=800.0))
    save_terrain(path, high)
    np.testing.assert_allclose(load_terrain(path).elevations, high.elevations, atol=1e-4)


@pytest.mark.parametrize("second", SUFFIXES)
@pytest.mark.parametrize("first", SUFFIXES)
def test_map_goes_from_format_to_format_with_heights_cell_and_place(tmp_path, first, second):
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
def test_heights_above_a_datum_come_back_with_it(tmp_path, suffix):
    path = tmp_path / f"site{suffix}"
    high = HeightMap(GRID, HEIGHTS, Georeference("EPSG:32633", 0.0, 9.0, elevation=800.1))
    save_terrain(path, high)
    back = load_terrain(path)
    assert back.georeference == high.georeference
    atol = 0.5001 * np.ptp(HEIGHTS) / 65535 if suffix == ".png" else 1e-12
    np.testing.assert_allclose(back.heights, HEIGHTS, rtol=0, atol=atol)


def test_ascii_grid_above_a_datum_comes_back_as_elevations(tmp_path):
    place = Georeference("", 0.0, 9.0, elevation=800.0)
    save_terrain(tmp_path / "site.asc", HeightMap(GRID, HEIGHTS, place))
    back = load_terrain(tmp_path / "site.asc")
    assert back.georeference == Georeference("", 0.0, 9.0)
    assert np.array_equal(back.heights, HEIGHTS + 800.0)


@pytest.mark.parametrize("suffix", [".asc", ".tif", ".tiff"])
def test_elevations_that_would_not_be_read_back_are_refused_at_saving(tmp_path, suffix):
    place = Georeference("", 0.0, 9.0, elevation=-9999.0)
    with pytest.raises(TerrainError, match="beyond the limit of 9000 m"):
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
def test_any_map_comes_back(tmp_path, data, suffix, shape, cell, easting, northing):
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
def test_given_cell_stretches_the_ground_and_drops_its_place(tmp_path, suffix):
    stretched = load_terrain(saved(tmp_path, suffix), cell=2.0)
    assert stretched.grid == Grid(5, 7, 2.0)
    assert stretched.georeference is None


def test_cell_that_the_file_states_too_keeps_the_place(tmp_path):
    assert load_terrain(saved(tmp_path, ".tif"), cell=0.5).georeference == PLACE


@pytest.mark.parametrize("suffix", EXACT)
def test_heights_in_feet_become_metres(tmp_path, suffix):
    path = saved(tmp_path, suffix)
    scaled = load_terrain(path, cell=cell_for(path), vertical_scale=0.3048)
    assert np.array_equal(scaled.heights, HEIGHTS * 0.3048)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_suffix_may_be_in_capitals(tmp_path, suffix):
    path = saved(tmp_path, suffix.upper())
    assert path.exists()
    load_terrain(path, cell=0.5)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_file_is_refused_by_its_name(tmp_path, suffix):
    with pytest.raises(TerrainError, match=rf"nowhere\{suffix}: there is no such file"):
        load_terrain(tmp_path / f"nowhere{suffix}", cell=0.5)


def test_folder_in_place_of_a_file_is_refused(tmp_path):
    (tmp_path / "site.npz").mkdir()
    with pytest.raises(TerrainError, match="no such file"):
        load_terrain(tmp_path / "site.npz")


@pytest.mark.parametrize("name", ["site.obj", "site", "site.npz.bak"])
def test_unknown_suffix_is_refused_with_the_known_ones(tmp_path, name):
    with pytest.raises(TerrainError, match=r"give one of \.npy, \.npz, \.png, \.asc, \.tif"):
        load_terrain(tmp_path / name)
    with pytest.raises(TerrainError, match=r"give one of \.npy"):
        save_terrain(tmp_path / name, HeightMap(GRID, HEIGHTS))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("cell", [0.0, -0.2, float("nan"), float("inf"), "0.2", True])
def test_impossible_cell_is_refused(tmp_path, suffix, cell):
    with pytest.raises(TerrainError, match="give a positive spacing"):
        load_terrain(saved(tmp_path, suffix), cell=cell)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_vertical_scale_is_refused(tmp_path, scale):
    with pytest.raises(TerrainError, match="vertical_scale is"):
        load_terrain(saved(tmp_path, ".npz"), vertical_scale=scale)


@pytest.mark.parametrize("suffix", EXACT)
def test_height_range_is_refused_where_it_means_nothing(tmp_path, suffix):
    with pytest.raises(TerrainError, match=r"height_range applies to \.png only"):
        load_terrain(saved(tmp_path, suffix), cell=0.5, height_range=(0.0, 1.0))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_folder_that_does_not_exist_is_refused(tmp_path, suffix):
    with pytest.raises(TerrainError, match="give an existing folder"):
        saved(tmp_path / "nowhere", suffix)


def test_save_that_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = saved(tmp_path, ".tif")
    before = path.read_bytes()
    with pytest.raises(TerrainError, match="crs 'nonsense' is unknown"):
        save_terrain(path, HeightMap(GRID, HEIGHTS, Georeference("nonsense", 0.0, 0.0)))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_save_onto_a_folder_is_refused_and_leaves_nothing_behind(tmp_path, suffix):
    folder = tmp_path / f"site{suffix}"
    folder.mkdir()
    with pytest.raises(TerrainError, match="cannot be written"):
        saved(tmp_path, suffix)
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_empty_file_is_refused(tmp_path, suffix):
    path = tmp_path / f"site{suffix}"
    path.touch()
    with pytest.raises(TerrainError, match="site"):
        load_terrain(path, cell=0.5)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(part=st.floats(0.0, 0.9))
def test_truncated_file_is_refused(tmp_path, suffix, part):
    path = saved(tmp_path, suffix)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(TerrainError, match=r"site"):
        load_terrain(path, cell=0.5)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_damaged_bytes_make_a_map_or_a_terrain_error_never_another(tmp_path, suffix, data):
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
