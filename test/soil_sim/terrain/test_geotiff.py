"""GeoTIFFs: one north-up band in metres, with its georeference."""

import dataclasses

import numpy as np
import pytest
import rasterio
from rasterio.crs import CRS
from rasterio.transform import Affine
from support.terrain_errors import raises_terrain_error

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainErrorCode
from soil_sim.terrain import Georeference, HeightMap, load_terrain, save_terrain

PICTURE = np.arange(12.0).reshape(3, 4)


def from_origin(west, north, width, height):
    return Affine(width, 0.0, west, 0.0, -height, north)


def tif(folder, picture=PICTURE, **profile):
    path = folder / "site.tif"
    bands = picture if picture.ndim == 3 else picture[None]
    settings = {
        "driver": "GTiff",
        "count": bands.shape[0],
        "height": bands.shape[1],
        "width": bands.shape[2],
        "dtype": bands.dtype,
        "crs": "EPSG:32633",
        "transform": from_origin(500_000.0, 5_200_000.0, 2.0, 2.0),
        **profile,
    }
    with rasterio.open(path, "w", **settings) as dataset:
        dataset.write(bands)
    return path


@pytest.mark.parametrize("dtype", ["int16", "uint8", "int32", "float32", "float64"])
def test_band_of_any_numeric_type_is_read_north_up(tmp_path, dtype):
    loaded = load_terrain(tif(tmp_path, PICTURE.astype(dtype)))
    assert loaded.grid == Grid(4, 3, 2.0)
    assert np.array_equal(loaded.heights, PICTURE.T[::-1])


def test_georeference_is_the_centre_of_the_raster(tmp_path):
    place = load_terrain(tif(tmp_path)).georeference
    assert place == Georeference("EPSG:32633", 500_004.0, 5_199_997.0)


def test_crs_without_code_is_stored_as_wkt(tmp_path):
    mine = CRS.from_proj4("+proj=tmerc +lat_0=1 +lon_0=2 +k=1 +x_0=3 +y_0=4 +units=m")
    first = load_terrain(tif(tmp_path, crs=mine))
    save_terrain(tmp_path / "again.tif", first)
    with rasterio.open(tmp_path / "again.tif") as dataset:
        assert dataset.crs == mine


def test_georeference_of_a_saved_file_is_unchanged(tmp_path):
    save_terrain(tmp_path / "again.tif", load_terrain(tif(tmp_path)))
    with rasterio.open(tmp_path / "site.tif") as old, rasterio.open(tmp_path / "again.tif") as new:
        assert (new.crs, new.transform, new.bounds) == (old.crs, old.transform, old.bounds)
        assert np.array_equal(new.read(1), old.read(1))


def test_saved_file_has_elevations(tmp_path):
    place = Georeference("EPSG:32633", 0.0, 9.0, elevation=100.0)
    save_terrain(tmp_path / "site.tif", HeightMap(Grid(2, 2, 1.0), np.ones((2, 2)), place))
    with rasterio.open(tmp_path / "site.tif") as dataset:
        assert (dataset.read(1) == 101.0).all()


def test_saved_file_declares_metres_and_nodata(tmp_path):
    save_terrain(tmp_path / "site.tif", HeightMap(Grid(2, 2, 1.0), np.ones((2, 2))))
    with rasterio.open(tmp_path / "site.tif") as dataset:
        assert dataset.units == ("metre",)
        assert dataset.nodata == -9999.0
    assert [file.name for file in tmp_path.iterdir()] == ["site.tif"]


def test_heights_in_feet_are_rejected_unless_vertical_scale_is_given(tmp_path):
    path = tif(tmp_path)
    with rasterio.open(path, "r+") as dataset:
        dataset.units = ("US survey foot",)
    with raises_terrain_error(TerrainErrorCode.HEIGHT_UNIT):
        load_terrain(path)
    loaded = load_terrain(path, vertical_scale=0.3048006)
    np.testing.assert_allclose(loaded.heights, PICTURE.T[::-1] * 0.3048006)


@pytest.mark.parametrize("z0", ["high", "nan", "inf"])
def test_invalid_datum_tag_is_rejected(tmp_path, z0):
    path = tif(tmp_path)
    with rasterio.open(path, "r+") as dataset:
        dataset.update_tags(EARTHMOVING_SIM_Z0=z0)
    with raises_terrain_error(TerrainErrorCode.GEOREFERENCE):
        load_terrain(path)


def test_tag_that_is_not_text_is_rejected(tmp_path):
    path = tmp_path / "site.tif"
    save_terrain(path, HeightMap(Grid(2, 2, 1.0), np.ones((2, 2))))
    content = path.read_bytes()
    assert content.count(b">metre<") == 1
    path.write_bytes(content.replace(b">metre<", b">met\xffe<"))
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(path)


def test_file_without_datum_tag_keeps_its_elevations(tmp_path):
    path = tmp_path / "site.tif"
    place = Georeference("EPSG:32633", 0.0, 9.0, elevation=800.1)
    save_terrain(path, HeightMap(Grid(2, 2, 1.0), np.ones((2, 2)), place))
    content = path.read_bytes()
    assert content.count(b"800.1") == 1
    path.write_bytes(content.replace(b"EARTHMOVING_SIM_Z0", b"another program's "))
    loaded = load_terrain(path)
    assert loaded.georeference == dataclasses.replace(place, elevation=0.0)
    assert (loaded.heights == 801.1).all()


def test_scale_and_offset_of_the_band_are_applied(tmp_path):
    path = tif(tmp_path, PICTURE.astype("int16"))
    with rasterio.open(path, "r+") as dataset:
        dataset.scales, dataset.offsets = (0.1,), (50.0,)
    np.testing.assert_allclose(load_terrain(path).heights, PICTURE.T[::-1] * 0.1 + 50.0)


@pytest.mark.parametrize("nodata", [-9999.0, float("nan"), 7.0])
def test_error_of_missing_heights_has_their_number_and_position(tmp_path, nodata):
    picture = np.ones((3, 4))
    picture[1, 2] = picture[2, 0] = nodata
    with raises_terrain_error(
        TerrainErrorCode.HEIGHT, match=r"2 of 12 pixels have no height.*row 1, column 2"
    ):
        load_terrain(tif(tmp_path, picture, nodata=nodata))


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_nan_heights_are_rejected_without_nodata(tmp_path, bad):
    picture = np.ones((3, 4))
    picture[2, 3] = bad
    with raises_terrain_error(TerrainErrorCode.HEIGHT):
        load_terrain(tif(tmp_path, picture))


def test_undeclared_nodata_value_is_rejected(tmp_path):
    picture = PICTURE.astype("int16")
    picture[0, 0] = -32768
    with raises_terrain_error(TerrainErrorCode.HEIGHT):
        load_terrain(tif(tmp_path, picture))


def test_several_bands_are_rejected(tmp_path):
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        load_terrain(tif(tmp_path, np.zeros((3, 4, 4), dtype="uint8")))


def test_complex_band_is_rejected(tmp_path):
    with raises_terrain_error(TerrainErrorCode.UNSUPPORTED):
        load_terrain(tif(tmp_path, PICTURE.astype("complex64")))


def test_band_of_one_row_is_rejected(tmp_path):
    with raises_terrain_error(TerrainErrorCode.SHAPE):
        load_terrain(tif(tmp_path, PICTURE[:1]))


@pytest.mark.parametrize(
    "transform",
    [
        Affine(2.0, 0.0, 0.0, 0.0, 2.0, 0.0),
        Affine(-2.0, 0.0, 0.0, 0.0, -2.0, 0.0),
        Affine(2.0, 0.1, 0.0, 0.1, -2.0, 0.0),
    ],
    ids=["south-up", "east-left", "turned"],
)
@pytest.mark.parametrize("cell", [None, 2.0])
def test_raster_that_is_not_north_up_is_rejected(tmp_path, transform, cell):
    with raises_terrain_error(TerrainErrorCode.GEOREFERENCE):
        load_terrain(tif(tmp_path, transform=transform), cell=cell)


SPACING_NOT_IN_METRES = pytest.mark.parametrize(
    "profile",
    [
        {"crs": "EPSG:4326", "transform": from_origin(14.0, 47.0, 1e-2, 1e-2)},
        {"crs": "EPSG:2263"},
        {"transform": from_origin(0.0, 0.0, 2.0, 3.0)},
    ],
    ids=["degrees", "US survey feet", "not square"],
)


@SPACING_NOT_IN_METRES
def test_spacing_in_other_units_than_metres_is_rejected(tmp_path, profile):
    with raises_terrain_error(TerrainErrorCode.CELL_SIZE):
        load_terrain(tif(tmp_path, **profile))


@SPACING_NOT_IN_METRES
def test_spacing_in_other_units_is_accepted_with_a_given_cell_size(tmp_path, profile):
    loaded = load_terrain(tif(tmp_path, **profile), cell=30.0)
    assert loaded.grid == Grid(4, 3, 30.0)
    assert loaded.georeference is None


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_tiff_without_georeference_needs_a_cell_size(tmp_path):
    path = tif(tmp_path, crs=None, transform=Affine.identity())
    with raises_terrain_error(TerrainErrorCode.CELL_SIZE):
        load_terrain(path)
    assert load_terrain(path, cell=0.2).grid == Grid(4, 3, 0.2)


def test_coordinates_in_metres_without_crs_are_kept(tmp_path):
    place = load_terrain(tif(tmp_path, crs=None)).georeference
    assert place == Georeference("", 500_004.0, 5_199_997.0)


def test_raster_of_another_format_named_tif_is_rejected(tmp_path):
    (tmp_path / "site.tif").write_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n")
    with raises_terrain_error(TerrainErrorCode.INVALID_FILE):
        load_terrain(tmp_path / "site.tif")


def test_gdal_reads_every_height_at_its_easting_and_northing(tmp_path):
    path = tif(tmp_path)
    loaded = load_terrain(path)
    place = loaded.georeference
    rows, cols = np.indices(loaded.grid.shape)
    points = zip(
        (place.easting + loaded.grid.x(rows)).flat,
        (place.northing + loaded.grid.y(cols)).flat,
        strict=True,
    )
    with rasterio.open(path) as dataset:
        sampled = np.array(list(dataset.sample(points)))
    assert np.array_equal(sampled.ravel(), loaded.heights.ravel())
