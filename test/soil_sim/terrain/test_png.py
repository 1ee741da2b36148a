"""16-bit PNGs: north-up, their values spread over a range of heights."""

import json

import numpy as np
import pytest
from PIL import Image, PngImagePlugin
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainErrorCode
from soil_sim.terrain import HeightMap, flat, load_terrain, save_terrain

KEY = "earthmoving_sim terrain"


def png(folder, values, text=None):
    path = folder / "site.png"
    chunk = PngImagePlugin.PngInfo()
    if text is not None:
        chunk.add_text(KEY, text)
    Image.fromarray(values).save(path, pnginfo=chunk)
    return path


def test_values_are_mapped_to_the_height_range_north_up(tmp_path):
    values = np.array([[0, 13107, 65535], [0, 0, 0]], dtype=np.uint16)
    loaded = load_terrain(png(tmp_path, values), cell=0.5, height_range=(-10.0, 40.0))
    assert loaded.grid == Grid(3, 2, 0.5)
    np.testing.assert_allclose(loaded.heights, [[40.0, -10.0], [0.0, -10.0], [-10.0, -10.0]])


def test_heights_round_trip_within_half_a_quantization_step(tmp_path):
    heights = np.random.default_rng(0).uniform(-3.0, 5.0, (20, 30))
    save_terrain(tmp_path / "site.png", HeightMap(Grid(20, 30, 0.2), heights))
    loaded = load_terrain(tmp_path / "site.png").heights
    np.testing.assert_allclose(loaded, heights, rtol=0, atol=0.5 * 8.0 / 65535)


def test_flat_terrain_round_trips_exactly(tmp_path):
    save_terrain(tmp_path / "site.png", flat(Grid(3, 4, 0.2), 7.25))
    assert (load_terrain(tmp_path / "site.png").heights == 7.25).all()


def test_nearly_equal_heights_round_trip(tmp_path):
    heights = np.array([[0.0, 5e-324], [1e-310, 0.0]])
    save_terrain(tmp_path / "site.png", HeightMap(Grid(2, 2, 0.2), heights))
    np.testing.assert_allclose(load_terrain(tmp_path / "site.png").heights, heights, atol=1e-309)


def test_rounding_does_not_raise_the_highest_height(tmp_path):
    low, high = -7384.049942746633, 9000.0  # the limit of heights
    assert low + 65535 * ((high - low) / 65535) > high
    save_terrain(tmp_path / "site.png", HeightMap(Grid(2, 2, 0.2), np.array([[low, 0], [0, high]])))
    assert load_terrain(tmp_path / "site.png").heights.max() == high


def test_height_range_is_stored_in_the_file(tmp_path):
    heights = np.array([[-2.0, 3.0], [0.0, 1.0]])
    save_terrain(tmp_path / "site.png", HeightMap(Grid(2, 2, 0.2), heights))
    with Image.open(tmp_path / "site.png") as image:
        assert json.loads(image.info[KEY])["height_range"] == [-2.0, 3.0]
        assert np.array_equal(image, [[26214, 0], [39321, 65535]])


def test_given_height_range_is_used_when_saving(tmp_path):
    save_terrain(tmp_path / "site.png", flat(Grid(3, 4, 0.2), 5.0), height_range=(0.0, 10.0))
    with Image.open(tmp_path / "site.png") as image:
        assert (np.asarray(image) == 32768).all()


def test_given_height_range_overrides_that_of_the_file(tmp_path):
    save_terrain(tmp_path / "site.png", flat(Grid(3, 4, 0.2)), height_range=(0.0, 10.0))
    loaded = load_terrain(tmp_path / "site.png", height_range=(100.0, 200.0))
    assert (loaded.heights == 100.0).all()


def test_heights_beyond_the_range_are_rejected_when_saving(tmp_path):
    with raises_terrain_error(TerrainErrorCode.HEIGHT_RANGE):
        save_terrain(tmp_path / "site.png", flat(Grid(3, 4, 0.2), 5.0), height_range=(0.0, 4.0))


def test_png_without_height_range_is_rejected(tmp_path):
    with raises_terrain_error(
        TerrainErrorCode.HEIGHT_RANGE, match=r"give height_range=\(low, high\)"
    ):
        load_terrain(png(tmp_path, np.zeros((3, 3), dtype=np.uint16)), cell=0.5)


def test_png_without_cell_size_is_rejected(tmp_path):
    with raises_terrain_error(TerrainErrorCode.CELL_SIZE):
        load_terrain(png(tmp_path, np.zeros((3, 3), dtype=np.uint16)), height_range=(0, 1))


@pytest.mark.parametrize("bad", [(1.0, 1.0), (2.0, 1.0), (0.0, np.nan), (0.0,), 5.0, "ab"])
def test_invalid_height_range_is_rejected(tmp_path, bad):
    path = png(tmp_path, np.zeros((3, 3), dtype=np.uint16))
    with raises_terrain_error(TerrainErrorCode.HEIGHT_RANGE):
        load_terrain(path, cell=0.5, height_range=bad)


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 2), (4, 4, 3), (4, 4, 4)])
def test_8_bit_or_colour_png_is_rejected(tmp_path, shape):
    path = png(tmp_path, np.zeros(shape, dtype=np.uint8))
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        load_terrain(path, cell=0.5, height_range=(0.0, 1.0))


def test_image_of_another_format_named_png_is_rejected(tmp_path):
    Image.fromarray(np.zeros((4, 4), dtype=np.uint8)).save(tmp_path / "site.png", format="BMP")
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(tmp_path / "site.png", cell=0.5, height_range=(0.0, 1.0))


@pytest.mark.parametrize(
    "text",
    [
        "no json",
        "[]",
        "{}",
        '{"cell": "x", "height_range": [0, 1], "georeference": null}',
        '{"cell": 1.0, "height_range": [1, 0], "georeference": null}',
        '{"cell": 1.0, "height_range": [0, 1], "georeference": {"crs": 5}}',
        '{"cell": 1' + 400 * "0" + ', "height_range": [0, 1], "georeference": null}',
    ],
)
def test_corrupted_text_chunk_is_rejected(tmp_path, text):
    path = png(tmp_path, np.zeros((3, 3), dtype=np.uint16), text)
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(path)


def test_png_with_complete_pixels_but_truncated_end_is_rejected(tmp_path):
    path = png(tmp_path, np.zeros((3, 3), dtype=np.uint16))
    end_chunk = 12  # length, name and checksum of IEND
    path.write_bytes(path.read_bytes()[:-end_chunk])
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(path, cell=0.5, height_range=(0.0, 1.0))
