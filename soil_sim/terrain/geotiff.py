"""Terrain as a GeoTIFF: one band of elevations, north-up, in a projected system in metres."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soil_sim.errors import TerrainError
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.heights import HeightMap, height_array
from soil_sim.terrain.north_up import matrix_from_picture, to_north_up
from soil_sim.terrain.reading import Reading

__all__ = ["read_geotiff", "write_geotiff"]

_SQUARE = 1e-6
"""Relative difference of a pixel's sides that is rounding."""


def read_geotiff(path: Path, *, cell_given: bool) -> Reading:
    """Read band 1 with its scale and offset applied.

    Args:
        path: the file.
        cell_given: the caller brings the spacing, so one that is not in metres may pass.

    Raises:
        TerrainError: a damaged file, several bands, missing heights, or a grid that is not
            north-up, square and in metres.
    """
    rasterio = _rasterio()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(path, driver="GTiff") as dataset:
                matrix = matrix_from_picture(_elevations(dataset))
                if dataset.transform.is_identity:  # a plain TIFF
                    return Reading(matrix)
                return _located(rasterio, dataset, matrix, cell_given)
    except (rasterio.errors.RasterioError, rasterio.errors.RasterioIOError) as error:
        raise TerrainError(f"it is no complete GeoTIFF ({error}); export it again") from error


def write_geotiff(path: Path, height_map: HeightMap) -> None:
    """Write elevations as float64; ground without georeference is centred on (0, 0).

    Raises:
        TerrainError: the georeference's crs is not one that PROJ knows.
    """
    rasterio = _rasterio()
    place = height_map.georeference or Georeference("", 0.0, 0.0)
    cell = height_map.grid.cell
    picture = to_north_up(height_map.elevations)
    rows, cols = picture.shape
    west, north = place.easting - 0.5 * cols * cell, place.northing + 0.5 * rows * cell
    try:
        crs = rasterio.crs.CRS.from_user_input(place.crs) if place.crs else None
    except rasterio.errors.CRSError as error:
        raise TerrainError(
            f"crs {place.crs!r} is unknown ({error}); give an EPSG code or WKT"
        ) from error
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=rows,
        width=cols,
        count=1,
        dtype="float64",
        crs=crs,
        transform=rasterio.Affine(cell, 0.0, west, 0.0, -cell, north),
        compress="deflate",
    ) as dataset:
        dataset.write(picture, 1)


def _rasterio() -> Any:
    """rasterio, loaded only by those who read or write a GeoTIFF: it brings all of GDAL."""
    try:
        import rasterio
        import rasterio.crs
        import rasterio.errors
    except ImportError as error:
        raise TerrainError(
            "a GeoTIFF needs rasterio; install it by pip, or convert the file to .asc"
        ) from error
    return rasterio


def _elevations(dataset: Any) -> NDArray[np.float64]:
    """Heights of the only band, shape (height, width), none missing."""
    if dataset.count != 1:
        raise TerrainError(f"it has {dataset.count} bands; export one band of elevations")
    picture = height_array(dataset.read(1))
    empty = np.argwhere((dataset.read_masks(1) == 0) | ~np.isfinite(picture))
    if empty.size:
        row, col = empty[0]
        raise TerrainError(
            f"{len(empty)} of {picture.size} pixels have no height, the first at row {row},"
            f" column {col} from the north-west; fill them (gdal_fillnodata) or crop them away"
        )
    return np.asarray(picture * dataset.scales[0] + dataset.offsets[0])


def _located(rasterio: Any, dataset: Any, matrix: NDArray[np.float64], cell_given: bool) -> Reading:
    """The reading with spacing and place, where they are in metres."""
    t = dataset.transform
    if not (t.a > 0.0 and t.e < 0.0 and t.b == 0.0 and t.d == 0.0):
        raise TerrainError("it is not north-up; turn it so with gdalwarp")
    unusable = _why_no_spacing(rasterio, dataset)
    if unusable and not cell_given:
        raise TerrainError(
            f"{unusable}; reproject it with gdalwarp (-t_srs of a projected system in metres,"
            " -tr with equal sides), or give cell, the spacing to take it for, in metres"
        )
    if unusable:
        return Reading(matrix)
    easting, northing = t.c + 0.5 * dataset.width * t.a, t.f + 0.5 * dataset.height * t.e
    crs = _crs_text(rasterio, dataset.crs)
    at_origin = not crs and abs(easting) < 1e-9 * t.a and abs(northing) < 1e-9 * t.a
    return Reading(matrix, t.a, None if at_origin else Georeference(crs, easting, northing))


def _why_no_spacing(rasterio: Any, dataset: Any) -> str:
    """Why the pixel size is no spacing in metres; empty if it is one."""
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
    if abs(t.a + t.e) > _SQUARE * t.a:
        return f"its pixels are not square ({t.a:g} x {-t.e:g} m)"
    return ""


def _crs_text(rasterio: Any, crs: Any) -> str:
    """The EPSG code where it says all that the file says, else WKT; empty for none."""
    if not crs:
        return ""
    code = crs.to_epsg()
    if code is not None and rasterio.crs.CRS.from_epsg(code) == crs:
        return f"EPSG:{code}"
    return str(crs.to_wkt())
