"""Terrain as a GeoTIFF: one band of elevations, north-up, in a projected system in metres.

The tag EARTHMOVING_SIM_Z0 stores the elevation of z = 0, so that heights are restored exactly;
other programs read elevations.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.height_map import HeightMap, as_height_array, validated_elevations
from soil_sim.terrain.north_up import matrix_from_north_up, to_north_up
from soil_sim.terrain.raster import TerrainRaster

__all__ = [
    "read_geotiff",
    "read_geotiff_values",
    "same_crs",
    "write_geotiff",
    "write_geotiff_values",
]

_SQUARE_PIXEL_TOLERANCE = 1e-6
"""Maximum relative difference of the sides of a square pixel."""

_Z0 = "EARTHMOVING_SIM_Z0"
_METRES = ("", "unknown", "m", "metre", "metres", "meter", "meters")
_NODATA = -9999.0


def read_geotiff(
    path: Path, *, has_cell: bool, has_vertical_scale: bool = False, keep_nodata: bool = False
) -> TerrainRaster:
    """Read the heights of band 1, with its scale and offset applied.

    Args:
        path: the file.
        has_cell: whether the caller gives the spacing; that of the file is then not checked.
        has_vertical_scale: whether the caller gives the vertical unit; that of the file is then
            not checked.
        keep_nodata: whether missing heights become NaN; otherwise they are rejected.

    Raises:
        TerrainError: the file is damaged, has several bands, missing heights or heights in another
            unit than metres, or its grid is not north-up, square and in metres.
    """
    reading, unit = _read_raster(path, has_cell=has_cell, keep_nodata=keep_nodata)
    if unit.lower() not in _METRES and not has_vertical_scale:
        raise TerrainError(
            f"its heights are in {unit!r}, not metres; give vertical_scale, the metres in one"
            " of it",
            TerrainErrorCode.HEIGHT_UNIT,
        )
    if reading.georeference is None:
        return reading
    return dataclasses.replace(reading, heights=reading.heights - reading.georeference.elevation)


def read_geotiff_values(path: Path) -> TerrainRaster:
    """Read the values of band 1 without a check of their unit; missing values are NaN.

    Raises:
        TerrainError: the file is damaged or has several bands, or its grid is not north-up.
    """
    return _read_raster(path, has_cell=True, keep_nodata=True)[0]


def _read_raster(path: Path, *, has_cell: bool, keep_nodata: bool) -> tuple[TerrainRaster, str]:
    """Return band 1 and its unit."""
    rasterio = _import_rasterio()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(path, driver="GTiff") as dataset:
                matrix = matrix_from_north_up(_read_band(dataset, keep_nodata))
                unit = dataset.units[0] or ""
                if dataset.transform.is_identity:  # a plain TIFF
                    return TerrainRaster(matrix), unit
                return _georeferenced_raster(rasterio, dataset, matrix, has_cell), unit
    except (
        rasterio.errors.RasterioError,
        rasterio.errors.RasterioIOError,
        UnicodeDecodeError,  # of damaged tags
    ) as error:
        raise TerrainError(
            f"it is not a complete GeoTIFF ({error}); export it again",
            TerrainErrorCode.INVALID_FILE,
        ) from error


def write_geotiff(path: Path, height_map: HeightMap) -> None:
    """Write elevations as float64, -9999 declared as nodata and metre as the unit.

    A map without georeference is centred on (0, 0).

    Raises:
        TerrainError: the crs of the georeference is unknown to PROJ, or an elevation exceeds
            `HEIGHT_LIMIT`.
    """
    place = height_map.georeference
    write_geotiff_values(
        path,
        validated_elevations(height_map),
        height_map.grid.cell,
        place,
        nodata=_NODATA,
        unit="metre",
        tags={_Z0: repr(float(place.elevation))} if place and place.elevation else {},
    )


def write_geotiff_values(
    path: Path,
    values: NDArray[Any],
    cell: float,
    georeference: Georeference | None,
    *,
    nodata: float | None = None,
    unit: str = "",
    tags: dict[str, str] | None = None,
) -> None:
    """Write one band with the dtype of the values, shape (rows, cols), in matrix order.

    Raises:
        TerrainError: the crs of the georeference is unknown to PROJ.
    """
    rasterio = _import_rasterio()
    place = georeference or Georeference("", 0.0, 0.0)
    picture = to_north_up(values)
    rows, cols = picture.shape
    west, north = place.easting - 0.5 * cols * cell, place.northing + 0.5 * rows * cell
    try:
        crs = rasterio.crs.CRS.from_user_input(place.crs) if place.crs else None
    except rasterio.errors.CRSError as error:
        raise TerrainError(
            f"crs {place.crs!r} is unknown ({error}); give an EPSG code or WKT",
            TerrainErrorCode.GEOREFERENCE,
        ) from error
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=rows,
        width=cols,
        count=1,
        dtype=picture.dtype.name,
        nodata=nodata,
        crs=crs,
        transform=rasterio.Affine(cell, 0.0, west, 0.0, -cell, north),
        compress="deflate",
    ) as dataset:
        # Written before the pixels: a truncated file then lacks pixels and is rejected.
        if unit:
            dataset.units = (unit,)
        if tags:
            dataset.update_tags(**tags)
        dataset.write(picture, 1)


def same_crs(one: str, other: str) -> bool:
    """Return whether two texts denote the same crs; an empty text matches any."""
    if not one or not other or one == other:
        return True
    rasterio = _import_rasterio()
    try:
        systems = [rasterio.crs.CRS.from_user_input(text) for text in (one, other)]
    except rasterio.errors.CRSError:
        return False
    return bool(systems[0] == systems[1])


def _import_rasterio() -> Any:
    """Import rasterio on first use, because it loads GDAL."""
    try:
        import rasterio
        import rasterio.crs
        import rasterio.errors
    except ImportError as error:
        raise TerrainError(
            "a GeoTIFF needs rasterio; install it with pip, or convert the file to .asc",
            TerrainErrorCode.UNSUPPORTED,
        ) from error
    return rasterio


def _read_band(dataset: Any, keep_nodata: bool) -> NDArray[np.float64]:
    """Return the only band, shape (height, width); missing values are NaN or rejected."""
    if dataset.count != 1:
        raise TerrainError(
            f"it has {dataset.count} bands; export one band of elevations",
            TerrainErrorCode.UNSUPPORTED,
        )
    picture = as_height_array(dataset.read(1), "values")
    missing = dataset.read_masks(1) == 0
    empty = np.argwhere(missing | ~np.isfinite(picture))
    if empty.size and not keep_nodata:
        row, col = empty[0]
        raise TerrainError(
            f"{len(empty)} of {picture.size} pixels have no height, the first at row {row},"
            f" column {col} from the north-west; fill them (gdal_fillnodata) or crop them away",
            TerrainErrorCode.HEIGHT,
        )
    picture = np.asarray(picture * dataset.scales[0] + dataset.offsets[0])
    picture[missing] = np.nan
    return picture


def _georeferenced_raster(
    rasterio: Any, dataset: Any, matrix: NDArray[np.float64], has_cell: bool
) -> TerrainRaster:
    """Return the raster with spacing and georeference, if they are in metres."""
    t = dataset.transform
    if not (t.a > 0.0 and t.e < 0.0 and t.b == 0.0 and t.d == 0.0):
        raise TerrainError(
            "it is not north-up; rotate it with gdalwarp", TerrainErrorCode.GEOREFERENCE
        )
    problem = _spacing_problem(rasterio, dataset)
    if problem and not has_cell:
        raise TerrainError(
            f"{problem}; reproject it with gdalwarp (-t_srs of a projected system in metres,"
            " -tr with equal sides), or give cell, the spacing in metres",
            TerrainErrorCode.CELL_SIZE,
        )
    if problem:
        return TerrainRaster(matrix)
    easting, northing = t.c + 0.5 * dataset.width * t.a, t.f + 0.5 * dataset.height * t.e
    crs = _crs_text(rasterio, dataset.crs)
    z0 = _elevation_of_z0(dataset.tags())
    is_at_origin = not (crs or z0) and abs(easting) < 1e-9 * t.a and abs(northing) < 1e-9 * t.a
    return TerrainRaster(
        matrix, t.a, None if is_at_origin else Georeference(crs, easting, northing, z0)
    )


def _elevation_of_z0(tags: dict[str, str]) -> float:
    """Return the elevation of z = 0 [m] in the tag of a file, 0 without one."""
    try:
        z0 = float(tags.get(_Z0, "0"))
    except ValueError:
        z0 = math.nan
    if not math.isfinite(z0):
        raise TerrainError(
            f"its tag {_Z0} is {tags[_Z0]!r}; give the elevation of z = 0 in metres, or remove it",
            TerrainErrorCode.GEOREFERENCE,
        )
    return z0


def _spacing_problem(rasterio: Any, dataset: Any) -> str:
    """Return why the pixel size is not a spacing in metres; empty if it is."""
    t = dataset.transform
    if dataset.crs and dataset.crs.is_geographic:
        return "its coordinates are degrees, not metres"
    if dataset.crs:
        try:
            unit, metres = dataset.crs.linear_units_factor
        except rasterio.errors.CRSError:
            unit, metres = "unknown", 0.0
        if metres != 1.0:
            return f"its coordinates are in units of {unit}, not metres"
    if abs(t.a + t.e) > _SQUARE_PIXEL_TOLERANCE * t.a:
        return f"its pixels are not square ({t.a:g} x {-t.e:g} m)"
    return ""


def _crs_text(rasterio: Any, crs: Any) -> str:
    """Return the EPSG code if it is equivalent to the crs, otherwise WKT; empty without a crs."""
    if not crs:
        return ""
    code = crs.to_epsg()
    if code is not None and rasterio.crs.CRS.from_epsg(code) == crs:
        return f"EPSG:{code}"
    return str(crs.to_wkt())
