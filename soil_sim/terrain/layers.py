"""Layers of a terrain: for every cell which soil it is and how moist, from files and back.

A layer lies on the terrain's grid and is uint8 in memory: soil ids, or moisture in percent of
saturation. Files hold

| suffix | order | soil | moisture |
|---|---|---|---|
| `.npy` | matrix | ids | fraction 0..1 |
| `.npz` | matrix | ids, as `soil` | fraction 0..1, as `moisture` |
| `.png` 8- or 16-bit grey | north-up picture | ids | percent, said in a text chunk we add |
| `.asc`, `.tif`, `.tiff` | north-up picture | ids | fraction 0..1 |

An `.npz` may hold heights and layers at once: `files` reads and writes those. What an id means is
for the caller to say.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError
from soil_sim.terrain.ascii_grid import read_ascii_grid, write_ascii_values
from soil_sim.terrain.file_access import (
    atomic_write,
    check_file_exists,
    validate_suffix,
    wrap_read_errors,
)
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.geotiff import read_geotiff_values, same_crs, write_geotiff_values
from soil_sim.terrain.height_map import as_height_array
from soil_sim.terrain.numpy_files import LAYER_NAMES, read_npy, read_npz, write_npz
from soil_sim.terrain.png import read_png_values, write_png_values
from soil_sim.terrain.raster import TerrainRaster

__all__ = [
    "LAYER_KINDS",
    "Layers",
    "layers_from_arrays",
    "load_layer",
    "moisture_percent",
    "save_layer",
    "soil_ids",
]

LAYER_KINDS = LAYER_NAMES
"""What `kind` may be."""

_NORTH_UP_SUFFIXES = (".png", ".asc", ".tif", ".tiff")


@dataclass(frozen=True, eq=False)
class Layers:
    """The layers of one terrain; None where there is none. Arrays are uint8, shape (rows, cols).

    Attributes:
        soil: id of each cell's soil.
        moisture: percent of saturation, 0 to 100.

    Raises:
        TerrainError: another type than uint8, or a moisture above 100.
    """

    soil: NDArray[np.uint8] | None = None
    moisture: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        for kind in LAYER_KINDS:
            layer = getattr(self, kind)
            if layer is not None:
                _check_layer(layer, kind)

    def to_npz_arrays(self, grid: Grid) -> dict[str, NDArray[Any]]:
        """What an `.npz` holds of them, by name.

        Raises:
            TerrainError: a layer whose shape is not the grid's.
        """
        arrays = {}
        for kind in LAYER_KINDS:
            layer = getattr(self, kind)
            if layer is not None:
                _check_shape(layer.shape, grid, kind)
                arrays[kind] = _to_file_values(layer, kind)
        return arrays


def load_layer(
    path: str | os.PathLike[str],
    grid: Grid,
    *,
    kind: str,
    percent: bool = False,
    georeference: Georeference | None = None,
) -> NDArray[np.uint8]:
    """One layer of a file, on the terrain's grid.

    Args:
        path: a file with one of the suffixes of terrain.
        grid: that of the terrain.
        kind: "soil" or "moisture".
        percent: the file's moisture is 0..100 instead of 0..1. Pictures written by `save_layer`
            say so themselves.
        georeference: that of the terrain, None not to compare it with the file's.

    Returns:
        Soil ids, or moisture in percent rounded to whole ones, shape (rows, cols), uint8, in
        matrix order.

    Raises:
        TerrainError: the file is missing, damaged or of an unknown kind; its shape, spacing or
            place is not the terrain's; cells have no value, or one that cannot be. The message
            starts with the path.
    """
    path = Path(path)
    with wrap_read_errors(path):
        suffix = validate_suffix(path)
        _check_kind(kind)
        check_file_exists(path)
        reading, percent = _read_layer(path, suffix, kind, percent)
        advice = ""
        if suffix in _NORTH_UP_SUFFIXES:
            advice = f", as a north-up picture {grid.rows} pixels wide and {grid.cols} high"
        _check_shape(reading.heights.shape, grid, kind, advice)
        _check_georeference(reading, grid, georeference)
        if kind == "soil":
            if percent:
                raise TerrainError("percent is for moisture only; leave it out")
            return soil_ids(reading.heights)
        return moisture_percent(reading.heights, percent=percent)


def save_layer(
    path: str | os.PathLike[str],
    layer: NDArray[np.uint8],
    grid: Grid,
    *,
    kind: str,
    georeference: Georeference | None = None,
) -> None:
    """Write one layer alone; a file already there is replaced, heights and all.

    Args:
        path: a file with one of the suffixes of terrain; its folder must exist.
        layer: soil ids or moisture in percent, shape (rows, cols), uint8, in matrix order.
        grid: that of the terrain.
        kind: "soil" or "moisture".
        georeference: that of the terrain; `.npy` has no room for it, `.asc` none for its crs.

    Raises:
        TerrainError: the layer cannot be one of the grid, or the file cannot be written. The
            message starts with the path.
    """
    path = Path(path)
    with atomic_write(path) as part:
        suffix = validate_suffix(path)
        _check_kind(kind)
        _check_layer(layer, kind)
        _check_shape(layer.shape, grid, kind)
        if suffix == ".npy":
            np.save(part, _to_file_values(layer, kind), allow_pickle=False)
        elif suffix == ".npz":
            write_npz(part, grid.cell, georeference, {kind: _to_file_values(layer, kind)})
        elif suffix == ".png":
            place = vars(georeference) if georeference else None
            record = {"kind": kind, "cell": grid.cell, "georeference": place}
            write_png_values(part, layer, record)
        elif suffix == ".asc":
            values = layer if kind == "soil" else layer / 100.0
            write_ascii_values(part, values, grid.cell, georeference)
        else:
            write_geotiff_values(part, _to_file_values(layer, kind), grid.cell, georeference)


def layers_from_arrays(
    arrays: dict[str, NDArray[np.float64]], shape: tuple[int, int], *, percent: bool = False
) -> Layers:
    """Layers from what an `.npz` holds of them, by name.

    Args:
        arrays: soil ids, moisture.
        shape: (rows, cols) of the heights beside them.
        percent: moisture is 0..100 instead of 0..1.

    Raises:
        TerrainError: another shape, cells without a value, or with one that cannot be.
    """
    for kind, values in arrays.items():
        if values.shape != shape:
            raise TerrainError(
                f"its {kind} has shape {values.shape}, its heights {shape}; give both the same"
            )
    soil, moisture = arrays.get("soil"), arrays.get("moisture")
    return Layers(
        None if soil is None else soil_ids(soil),
        None if moisture is None else moisture_percent(moisture, percent=percent),
    )


def soil_ids(values: ArrayLike) -> NDArray[np.uint8]:
    """Numbers, shape (rows, cols), as soil ids.

    Raises:
        TerrainError: a cell without a value, or one that is no whole number from 0 to 255.
    """
    array = as_height_array(values, "soil ids")
    _check_no_nodata(array, "soil")
    _reject_values(
        (array != np.rint(array)) | (array < 0.0) | (array > 255.0),
        array,
        "are no soil ids",
        "give whole numbers from 0 to 255",
    )
    return array.astype(np.uint8)


def moisture_percent(values: ArrayLike, *, percent: bool = False) -> NDArray[np.uint8]:
    """Moistures, shape (rows, cols), in percent, rounded to whole ones.

    Args:
        values: fractions 0..1 of saturation.
        percent: they are 0..100.

    Raises:
        TerrainError: a cell without a value, or with one out of range.
    """
    array = as_height_array(values, "moistures")
    _check_no_nodata(array, "moisture")
    top = 100.0 if percent else 1.0
    hint = "" if percent else ", or percent=True for moisture in percent"
    _reject_values(
        (array < 0.0) | (array > top),
        array,
        f"are no moisture from 0 to {top:g}",
        f"correct them{hint}",
    )
    return np.rint(array * (100.0 / top)).astype(np.uint8)


def _read_layer(path: Path, suffix: str, kind: str, percent: bool) -> tuple[TerrainRaster, bool]:
    """The values of a layer, NaN where missing, and whether moisture is in percent."""
    if suffix == ".npy":
        return read_npy(path, f"values of {kind}"), percent
    if suffix == ".npz":
        archive = read_npz(path, require_heights=False)
        if kind not in archive.layers:
            have = ", ".join(archive.layers) or "none"
            raise TerrainError(f"it holds no array {kind!r} (layers in it: {have}); add it")
        return TerrainRaster(archive.layers[kind], archive.cell, archive.georeference), percent
    if suffix == ".png":
        values, record = read_png_values(path)
        if record is None:
            return TerrainRaster(values), percent
        cell, place = _from_record(record, kind)
        return TerrainRaster(values, cell, place), kind == "moisture"
    if suffix == ".asc":
        return read_ascii_grid(path, keep_nodata=True), percent
    return read_geotiff_values(path), percent


def _from_record(record: dict[str, Any], kind: str) -> tuple[float, Georeference | None]:
    """Spacing [m] and place that a picture of ours states."""
    try:
        held, cell, place = record["kind"], float(record["cell"]), record["georeference"]
        georeference = Georeference(**place) if place else None
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise TerrainError(
            f"its text chunk about the layer is damaged ({error}); remove the chunk"
        ) from error
    if held != kind:
        raise TerrainError(f"it holds {held!r}, not {kind!r}; give the file of that layer")
    return cell, georeference


def _check_kind(kind: str) -> None:
    if kind not in LAYER_KINDS:
        raise TerrainError(f"kind is {kind!r}; give one of {', '.join(LAYER_KINDS)}")


def _check_layer(layer: NDArray[Any], kind: str) -> None:
    if not (isinstance(layer, np.ndarray) and layer.dtype == np.uint8):
        raise TerrainError(f"{kind} is no array of uint8; make one by soil_ids or moisture_percent")
    if kind == "moisture" and layer.size and layer.max() > 100:
        raise TerrainError(f"moisture goes up to {layer.max()} percent; give at most 100")


def _check_shape(shape: tuple[int, ...], grid: Grid, kind: str, advice: str = "") -> None:
    if shape != grid.shape:
        raise TerrainError(
            f"its {kind} has shape {shape} (rows, cols), the terrain {grid.shape}; give a layer of"
            f" {grid.rows} x {grid.cols} cells{advice}"
        )


def _check_georeference(
    reading: TerrainRaster, grid: Grid, georeference: Georeference | None
) -> None:
    """Refuse a layer that says it lies elsewhere than the terrain."""
    if reading.cell is not None and not math.isclose(reading.cell, grid.cell, rel_tol=1e-6):
        raise TerrainError(
            f"it states cells of {reading.cell:g} m, the terrain has cells of {grid.cell:g} m;"
            " resample it to the terrain's cells"
        )
    if georeference is None or reading.georeference is None:
        return
    if not same_crs(reading.georeference.crs, georeference.crs):
        raise TerrainError(
            f"its crs is {reading.georeference.crs!r}, the terrain's {georeference.crs!r};"
            " reproject it"
        )
    east = reading.georeference.easting - georeference.easting
    north = reading.georeference.northing - georeference.northing
    if max(abs(east), abs(north)) > 0.01 * grid.cell:
        raise TerrainError(
            f"it lies {east:g} m east and {north:g} m north of the terrain; crop or resample it to"
            " the terrain's extent"
        )


def _check_no_nodata(array: NDArray[np.float64], kind: str) -> None:
    gaps = int(np.isnan(array).sum())
    if gaps:
        raise TerrainError(
            f"{gaps} of {array.size} cells have no {kind} (nodata or NaN); fill them"
        )


def _reject_values(
    bad: NDArray[np.bool_], array: NDArray[np.float64], what: str, advice: str
) -> None:
    if bad.any():
        row, col = np.argwhere(bad)[0]
        raise TerrainError(
            f"{bad.sum()} of {bad.size} values {what}, the first {array[row, col]:g} at row {row},"
            f" col {col}; {advice}"
        )


def _to_file_values(layer: NDArray[np.uint8], kind: str) -> NDArray[Any]:
    """Ids as they are, percent as a fraction."""
    return layer if kind == "soil" else (layer / 100.0).astype(np.float32)
