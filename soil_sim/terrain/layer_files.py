"""Files of one terrain layer: soil ids, or moisture in per cent of saturation (0 to 100).

| suffix | order of cells |
|---|---|
| `.npy` | matrix |
| `.npz` | matrix, in an array named `soil` or `moisture` |
| `.png` 8- or 16-bit grey | north-up image; `save_layer` adds spacing and place as text |
| `.asc`, `.tif`, `.tiff` | north-up image |
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain.ascii_grid import read_ascii_grid, write_ascii_values
from soil_sim.terrain.file_access import (
    atomic_write,
    check_file_exists,
    validate_suffix,
    wrap_read_errors,
)
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.geotiff import read_geotiff_values, same_crs, write_geotiff_values
from soil_sim.terrain.layers import (
    LAYER_KINDS,
    check_layer,
    check_layer_shape,
    moisture_percent,
    soil_ids,
)
from soil_sim.terrain.numpy_files import read_npy, read_npz, write_npz
from soil_sim.terrain.png import read_png_values, write_png_values
from soil_sim.terrain.raster import TerrainRaster

__all__ = ["load_layer", "save_layer"]

_NORTH_UP_SUFFIXES = (".png", ".asc", ".tif", ".tiff")

_MAX_OFFSET_CELLS = 0.01
"""Maximum offset between the origins of a layer and of its terrain [cells]."""


def load_layer(
    path: str | os.PathLike[str],
    grid: Grid,
    *,
    kind: str,
    georeference: Georeference | None = None,
) -> NDArray[np.uint8]:
    """Read one layer of a file, on the grid of the terrain.

    Args:
        path: file with a suffix of `SUFFIXES`.
        grid: grid of the terrain.
        kind: "soil" or "moisture".
        georeference: georeference of the terrain; None skips the comparison with that of the file.

    Returns:
        Soil ids, or moisture in whole per cents of saturation, shape (rows, cols), uint8, in
        matrix order.

    Raises:
        TerrainError: the file is missing, damaged or of an unknown format; its shape, spacing or
            place is not that of the terrain; cells have no value, or an invalid one (a moisture in
            fractions 0..1 is rejected). The message starts with the path.
    """
    path = Path(path)
    with wrap_read_errors(path):
        suffix = validate_suffix(path)
        _check_kind(kind)
        check_file_exists(path)
        raster = _read_layer(path, suffix, kind)
        hint = ""
        if suffix in _NORTH_UP_SUFFIXES:
            hint = f", as a north-up image {grid.rows} pixels wide and {grid.cols} high"
        check_layer_shape(raster.heights.shape, grid, kind, hint)
        _check_georeference(raster, grid, georeference)
        return (soil_ids if kind == "soil" else moisture_percent)(raster.heights)


def save_layer(
    path: str | os.PathLike[str],
    layer: NDArray[np.uint8],
    grid: Grid,
    *,
    kind: str,
    georeference: Georeference | None = None,
) -> None:
    """Write a file with one layer; an existing file is replaced, including any heights in it.

    Args:
        path: file with a suffix of `SUFFIXES`, in an existing folder.
        layer: soil ids or moisture [% of saturation], shape (rows, cols), uint8, in matrix order.
        grid: grid of the terrain.
        kind: "soil" or "moisture".
        georeference: georeference of the terrain; `.npy` cannot store it, `.asc` not its crs.

    Raises:
        TerrainError: the layer does not fit the grid, or the file cannot be written. The message
            starts with the path.
    """
    path = Path(path)
    with atomic_write(path) as part:
        suffix = validate_suffix(path)
        _check_kind(kind)
        check_layer(layer, kind)
        check_layer_shape(layer.shape, grid, kind)
        if suffix == ".npy":
            np.save(part, layer, allow_pickle=False)
        elif suffix == ".npz":
            write_npz(part, grid.cell, georeference, {kind: layer})
        elif suffix == ".png":
            place = vars(georeference) if georeference else None
            record = {"kind": kind, "cell": grid.cell, "georeference": place}
            write_png_values(part, layer, record)
        elif suffix == ".asc":
            write_ascii_values(part, layer, grid.cell, georeference)
        else:
            write_geotiff_values(part, layer, grid.cell, georeference)


def _read_layer(path: Path, suffix: str, kind: str) -> TerrainRaster:
    """Read the values of a layer; missing values are NaN."""
    if suffix == ".npy":
        return read_npy(path, f"values of {kind}")
    if suffix == ".npz":
        archive = read_npz(path, require_heights=False)
        if kind not in archive.layers:
            available = ", ".join(archive.layers) or "none"
            raise TerrainError(
                f"it has no array {kind!r} (layers in it: {available}); add it",
                TerrainErrorCode.LAYER,
            )
        return TerrainRaster(archive.layers[kind], archive.cell, archive.georeference)
    if suffix == ".png":
        values, record = read_png_values(path)
        if record is None:
            return TerrainRaster(values)
        cell, georeference = _parse_record(record, kind)
        return TerrainRaster(values, cell, georeference)
    if suffix == ".asc":
        return read_ascii_grid(path, keep_nodata=True)
    return read_geotiff_values(path)


def _parse_record(record: dict[str, Any], kind: str) -> tuple[float, Georeference | None]:
    """Return spacing [m] and georeference in the text chunk of a picture from `save_layer`."""
    try:
        recorded_kind, cell = record["kind"], float(record["cell"])
        place = record["georeference"]
        georeference = Georeference(**place) if place else None
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise TerrainError(
            f"its text chunk about the layer is damaged ({error}); remove the chunk",
            TerrainErrorCode.INVALID_FILE,
        ) from error
    if recorded_kind != kind:
        raise TerrainError(
            f"its layer is {recorded_kind!r}, not {kind!r}; give the file of that layer",
            TerrainErrorCode.LAYER,
        )
    return cell, georeference


def _check_kind(kind: str) -> None:
    if kind not in LAYER_KINDS:
        raise TerrainError(
            f"kind is {kind!r}; give one of {', '.join(LAYER_KINDS)}", TerrainErrorCode.LAYER
        )


def _check_georeference(
    raster: TerrainRaster, grid: Grid, georeference: Georeference | None
) -> None:
    """Check that the spacing and place of a layer, where the file states them, fit the terrain."""
    if raster.cell is not None and not math.isclose(raster.cell, grid.cell, rel_tol=1e-6):
        raise TerrainError(
            f"it states cells of {raster.cell:g} m, the terrain has cells of {grid.cell:g} m;"
            " resample it to the terrain's cells",
            TerrainErrorCode.CELL_SIZE,
        )
    if georeference is None or raster.georeference is None:
        return
    if not same_crs(raster.georeference.crs, georeference.crs):
        raise TerrainError(
            f"its crs is {raster.georeference.crs!r}, the terrain's {georeference.crs!r};"
            " reproject it",
            TerrainErrorCode.GEOREFERENCE,
        )
    east = raster.georeference.easting - georeference.easting
    north = raster.georeference.northing - georeference.northing
    if max(abs(east), abs(north)) > _MAX_OFFSET_CELLS * grid.cell:
        raise TerrainError(
            f"it lies {east:g} m east and {north:g} m north of the terrain; crop or resample it to"
            " the terrain's extent",
            TerrainErrorCode.GEOREFERENCE,
        )
