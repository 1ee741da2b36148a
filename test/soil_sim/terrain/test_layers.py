"""Layers match the terrain cell by cell; invalid soil ids and moistures are rejected."""

import numpy as np
import pytest
import rasterio
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from PIL import Image
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain import (
    SUFFIXES,
    Georeference,
    HeightMap,
    Layers,
    load_layer,
    load_terrain,
    load_terrain_with_layers,
    moisture_percent,
    save_layer,
    save_terrain,
    soil_ids,
    to_north_up,
)

GRID = Grid(3, 2, 0.5)
IDS = np.array([[0, 1], [2, 3], [254, 255]], dtype=np.uint8)
PERCENT = np.array([[0, 1], [29, 57], [99, 100]], dtype=np.uint8)
PLACE = Georeference("EPSG:32633", 500_000.0, 5_200_000.0)
LAYERS = {"soil": IDS, "moisture": PERCENT}
BOTH = pytest.mark.parametrize("kind", ["soil", "moisture"])


def npy(folder, values):
    np.save(folder / "layer.npy", values)
    return folder / "layer.npy"


def pixels(path):
    if path.suffix == ".png":
        with Image.open(path) as image:
            return np.array(image)
    with rasterio.open(path) as dataset:
        return dataset.read(1)


@BOTH
@pytest.mark.parametrize("place", [None, PLACE])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_layer_round_trips(tmp_path, suffix, kind, place):
    path = tmp_path / f"layer{suffix}"
    save_layer(path, LAYERS[kind], GRID, kind=kind, georeference=place)
    loaded = load_layer(path, GRID, kind=kind, georeference=PLACE)
    assert loaded.dtype == np.uint8
    assert np.array_equal(loaded, LAYERS[kind])


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    suffix=st.sampled_from(SUFFIXES),
    percent=npst.arrays(np.uint8, (3, 2), elements=st.integers(0, 100)),
)
def test_any_moisture_round_trips(tmp_path, suffix, percent):
    save_layer(tmp_path / f"layer{suffix}", percent, GRID, kind="moisture")
    back = load_layer(tmp_path / f"layer{suffix}", GRID, kind="moisture")
    assert np.array_equal(back, percent)


@BOTH
@pytest.mark.parametrize("suffix", [".png", ".asc", ".tif"])
def test_layer_has_the_orientation_of_heights(tmp_path, suffix, kind):
    save_layer(tmp_path / f"layer{suffix}", LAYERS[kind], GRID, kind=kind)
    save_terrain(tmp_path / f"site{suffix}", HeightMap(GRID, LAYERS[kind]))
    layer, site = pixels(tmp_path / f"layer{suffix}"), pixels(tmp_path / f"site{suffix}")
    assert np.array_equal(np.argsort(layer, axis=None), np.argsort(site, axis=None))


def test_soil_image_is_read_north_up(tmp_path):
    Image.fromarray(to_north_up(IDS).copy()).save(tmp_path / "soil.png")
    assert np.array_equal(load_layer(tmp_path / "soil.png", GRID, kind="soil"), IDS)


def test_16_bit_image_is_read(tmp_path):
    Image.fromarray(to_north_up(PERCENT).astype(np.uint16)).save(tmp_path / "wet.png")
    loaded = load_layer(tmp_path / "wet.png", GRID, kind="moisture")
    assert np.array_equal(loaded, PERCENT)


def test_colour_image_is_rejected(tmp_path):
    Image.fromarray(np.zeros((2, 3, 3), dtype=np.uint8)).save(tmp_path / "soil.png")
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        load_layer(tmp_path / "soil.png", GRID, kind="soil")


def test_palette_image_is_rejected(tmp_path):
    Image.fromarray(to_north_up(IDS).copy()).convert("P").save(tmp_path / "soil.png")
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        load_layer(tmp_path / "soil.png", GRID, kind="soil")


def test_saved_image_of_another_layer_is_rejected(tmp_path):
    save_layer(tmp_path / "wet.png", PERCENT, GRID, kind="moisture")
    with raises_terrain_error(TerrainErrorCode.LAYER):
        load_layer(tmp_path / "wet.png", GRID, kind="soil")


@BOTH
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_layer_of_another_shape_is_rejected(tmp_path, suffix, kind):
    path = tmp_path / f"layer{suffix}"
    save_layer(path, LAYERS[kind].T.copy(), Grid(2, 3, 0.5), kind=kind)
    with raises_terrain_error(TerrainErrorCode.SHAPE):
        load_layer(path, GRID, kind=kind)


def test_error_of_a_wrong_image_size_has_the_expected_one(tmp_path):
    Image.fromarray(IDS).save(tmp_path / "soil.png")
    with raises_terrain_error(TerrainErrorCode.SHAPE, match="3 pixels wide and 2 high"):
        load_layer(tmp_path / "soil.png", GRID, kind="soil")


@pytest.mark.parametrize("suffix", [".npz", ".png", ".asc", ".tif"])
def test_other_spacing_is_rejected(tmp_path, suffix):
    path = tmp_path / f"soil{suffix}"
    save_layer(path, IDS, GRID, kind="soil")
    with raises_terrain_error(TerrainErrorCode.CELL_SIZE):
        load_layer(path, Grid(3, 2, 0.2), kind="soil")


@pytest.mark.parametrize("suffix", [".npz", ".png", ".asc", ".tif"])
def test_layer_at_another_position_is_rejected(tmp_path, suffix):
    path = tmp_path / f"soil{suffix}"
    save_layer(path, IDS, GRID, kind="soil", georeference=PLACE)
    with raises_terrain_error(TerrainErrorCode.GEOREFERENCE):
        load_layer(path, GRID, kind="soil", georeference=PLACE.translated(0.0, -7.0))


def test_layer_in_another_crs_is_rejected(tmp_path):
    save_layer(tmp_path / "soil.tif", IDS, GRID, kind="soil", georeference=PLACE)
    other = Georeference("EPSG:32632", PLACE.easting, PLACE.northing)
    with raises_terrain_error(TerrainErrorCode.GEOREFERENCE):
        load_layer(tmp_path / "soil.tif", GRID, kind="soil", georeference=other)


@BOTH
def test_missing_values_in_an_array_are_rejected(tmp_path, kind):
    values = np.ones(GRID.shape)
    values[0, 0] = values[2, 1] = np.nan
    with raises_terrain_error(TerrainErrorCode.LAYER_VALUE):
        load_layer(npy(tmp_path, values), GRID, kind=kind)


@BOTH
def test_missing_values_in_an_ascii_grid_are_rejected(tmp_path, kind):
    (tmp_path / "layer.asc").write_text(
        "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 0.5\n1 -9999 1\n-9999 -9999 0\n"
    )
    with raises_terrain_error(TerrainErrorCode.LAYER_VALUE):
        load_layer(tmp_path / "layer.asc", GRID, kind=kind)


@BOTH
def test_missing_values_in_a_geotiff_are_rejected(tmp_path, kind):
    save_layer(tmp_path / "layer.tif", np.ones((3, 2), np.uint8), GRID, kind=kind)
    with rasterio.open(tmp_path / "layer.tif", "r+") as dataset:
        values = dataset.read(1)
        values[1, 1] = 0
        dataset.write(values, 1)
        dataset.nodata = 0
    with raises_terrain_error(TerrainErrorCode.LAYER_VALUE):
        load_layer(tmp_path / "layer.tif", GRID, kind=kind)


@pytest.mark.parametrize("bad", [0.5, -1.0, 256.0, np.inf, 1e300])
def test_invalid_soil_id_is_rejected(tmp_path, bad):
    values = IDS.astype(float)
    values[2, 0] = bad
    with raises_terrain_error(TerrainErrorCode.LAYER_VALUE):
        load_layer(npy(tmp_path, values), GRID, kind="soil")


@pytest.mark.parametrize("bad", [-0.01, 100.01, np.inf])
def test_moisture_out_of_range_is_rejected(tmp_path, bad):
    values = PERCENT.astype(float)
    values[1, 1] = bad
    with raises_terrain_error(TerrainErrorCode.LAYER_VALUE):
        load_layer(npy(tmp_path, values), GRID, kind="moisture")


def test_moisture_as_a_fraction_is_rejected(tmp_path):
    path = npy(tmp_path, PERCENT / 100.0)
    with raises_terrain_error(TerrainErrorCode.LAYER_VALUE):
        load_layer(path, GRID, kind="moisture")


def test_integer_moistures_up_to_one_percent_are_accepted(tmp_path):
    values = PERCENT % 2
    assert np.array_equal(load_layer(npy(tmp_path, values), GRID, kind="moisture"), values)


def test_moisture_is_rounded_to_integer_percent():
    assert moisture_percent([[12.4, 12.6], [99.4, 99.6]]).tolist() == [[12, 13], [99, 100]]


def test_ids_of_any_numeric_type_are_accepted():
    assert soil_ids([[1.0, 2.0], [3.0, 255.0]]).tolist() == [[1, 2], [3, 255]]


@pytest.mark.parametrize("kind", ["", "Soil", "heights", None])
def test_unknown_layer_is_rejected(tmp_path, kind):
    with raises_terrain_error(TerrainErrorCode.LAYER):
        load_layer(npy(tmp_path, IDS), GRID, kind=kind)
    with raises_terrain_error(TerrainErrorCode.LAYER):
        save_layer(tmp_path / "out.npy", IDS, GRID, kind=kind)
    assert not (tmp_path / "out.npy").exists()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_file_is_rejected(tmp_path, suffix):
    with raises_terrain_error(TerrainErrorCode.NO_FILE):
        load_layer(tmp_path / f"no{suffix}", GRID, kind="soil")


def test_layer_of_another_type_is_rejected_when_saving(tmp_path):
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        save_layer(tmp_path / "wet.npy", PERCENT / 2.0, GRID, kind="moisture")


def test_layer_of_another_shape_is_rejected_when_saving(tmp_path):
    with raises_terrain_error(TerrainErrorCode.SHAPE):
        save_layer(tmp_path / "soil.npy", IDS[:2], GRID, kind="soil")


def test_moisture_above_saturation_is_rejected_when_saving(tmp_path):
    with raises_terrain_error(TerrainErrorCode.LAYER_VALUE):
        save_layer(tmp_path / "wet.npy", PERCENT + np.uint8(1), GRID, kind="moisture")


def test_archive_contains_terrain_and_layers(tmp_path):
    path = tmp_path / "site.npz"
    site = HeightMap(GRID, np.arange(6.0).reshape(3, 2), PLACE)
    save_terrain(path, site, layers=Layers(IDS, PERCENT))
    loaded, layers = load_terrain_with_layers(path)
    assert np.array_equal(loaded.heights, site.heights)
    assert (loaded.grid, loaded.georeference) == (GRID, PLACE)
    assert np.array_equal(layers.soil, IDS)
    assert np.array_equal(layers.moisture, PERCENT)
    assert np.array_equal(load_terrain(path).heights, site.heights)
    assert np.array_equal(load_layer(path, GRID, kind="soil", georeference=PLACE), IDS)


def test_archive_without_layers_has_none(tmp_path):
    save_terrain(tmp_path / "site.npz", HeightMap(GRID, np.zeros((3, 2))))
    _, layers = load_terrain_with_layers(tmp_path / "site.npz")
    assert (layers.soil, layers.moisture) == (None, None)
    with raises_terrain_error(TerrainErrorCode.LAYER):
        load_layer(tmp_path / "site.npz", GRID, kind="soil")


@pytest.mark.parametrize("suffix", [suffix for suffix in SUFFIXES if suffix != ".npz"])
def test_layers_are_rejected_by_formats_without_them(tmp_path, suffix):
    site = HeightMap(GRID, np.zeros((3, 2)))
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        save_terrain(tmp_path / f"site{suffix}", site, layers=Layers(IDS))
    save_terrain(tmp_path / f"site{suffix}", site)
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        load_terrain_with_layers(tmp_path / f"site{suffix}", cell=0.5)


def test_layers_of_another_shape_than_the_heights_are_rejected(tmp_path):
    path = tmp_path / "site.npz"
    with raises_terrain_error(TerrainErrorCode.SHAPE):
        save_terrain(path, HeightMap(GRID, np.zeros((3, 2))), layers=Layers(IDS[:2]))
    np.savez(path, heights=np.zeros((3, 2)), cell=0.5, soil=IDS[:2])
    with raises_terrain_error(TerrainErrorCode.SHAPE):
        load_terrain_with_layers(path)


def test_moisture_of_an_archive_is_in_percent(tmp_path):
    path = tmp_path / "site.npz"
    np.savez(path, heights=np.zeros((3, 2)), cell=0.5, moisture=PERCENT)
    assert np.array_equal(load_terrain_with_layers(path)[1].moisture, PERCENT)
    np.savez(path, heights=np.zeros((3, 2)), cell=0.5, moisture=PERCENT / 100.0)
    with raises_terrain_error(TerrainErrorCode.LAYER_VALUE):
        load_terrain_with_layers(path)


@BOTH
@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_corrupted_layer_is_read_or_raises_terrain_error(tmp_path, suffix, kind, data):
    path = tmp_path / f"layer{suffix}"
    save_layer(path, LAYERS[kind], GRID, kind=kind, georeference=PLACE)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    try:
        loaded = load_layer(path, GRID, kind=kind)
    except TerrainError:
        return
    assert loaded.shape == GRID.shape
