"""Terrain as a 16-bit greyscale PNG, north-up: value 0 is the low and 65535 the high height.

A PNG does not state spacing or heights. Files written here have them in a text chunk and are read
without arguments. Heights are rounded to 1/65535 of their range.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.height_map import HeightMap
from soil_sim.terrain.north_up import matrix_from_north_up, to_north_up
from soil_sim.terrain.raster import TerrainRaster

__all__ = ["read_png", "read_png_values", "write_png", "write_png_values"]

_KEY = "earthmoving_sim terrain"
_MAX_GREY = 65535
_LAYER_KEY = "earthmoving_sim layer"
_SIXTEEN_BIT = ("I;16", "I;16L", "I;16B", "I")  # Pillow before 11 opens 16-bit grey as "I"


def read_png(path: Path, height_range: tuple[float, float] | None) -> TerrainRaster:
    """Read an image of heights.

    Args:
        path: the file.
        height_range: heights [m] of values 0 and 65535; None takes those of the text chunk.

    Raises:
        TerrainError: the file is not a complete 16-bit greyscale PNG, or states no height range.
    """
    mode, values, info = _decode(path)
    if mode not in _SIXTEEN_BIT:
        raise TerrainError(
            f"its pixels are {mode!r}, not 16-bit grey values; export a 16-bit"
            " greyscale PNG without alpha",
            TerrainErrorCode.UNSUPPORTED,
        )
    record = _parse_record(info.get(_KEY))
    if height_range is None and record is None:
        raise TerrainError(
            "a PNG does not state its heights; give height_range=(low, high) in metres",
            TerrainErrorCode.HEIGHT_RANGE,
        )
    low, high = validate_height_range(
        height_range if height_range is not None else record["height_range"]
    )
    # Rounding may give the highest value a height above `high`, which may be the limit of heights.
    picture = np.minimum(low + values * ((high - low) / _MAX_GREY), high)
    if record is None:
        return TerrainRaster(matrix_from_north_up(picture))
    place = Georeference(**record["georeference"]) if record["georeference"] else None
    return TerrainRaster(matrix_from_north_up(picture), record["cell"], place)


def write_png(path: Path, height_map: HeightMap, height_range: tuple[float, float] | None) -> None:
    """Write heights as 16-bit values, and spacing and height range as a text chunk.

    Args:
        path: the file.
        height_map: the map to write.
        height_range: heights [m] of values 0 and 65535; None takes the lowest and highest height.

    Raises:
        TerrainError: the range is invalid, or a height is outside of it.
    """
    heights = height_map.heights
    lowest, highest = float(heights.min()), float(heights.max())
    if height_range is None:
        height_range = (lowest, highest if highest > lowest else lowest + 1.0)
    low, high = validate_height_range(height_range)
    if lowest < low or highest > high:
        raise TerrainError(
            f"heights reach from {lowest} to {highest} m, beyond the height_range of {low} to"
            f" {high} m; give a range that includes them",
            TerrainErrorCode.HEIGHT_RANGE,
        )
    place = height_map.georeference
    record = {
        "cell": height_map.grid.cell,
        "height_range": [low, high],
        "georeference": vars(place) if place else None,
    }
    # Divided first: the inverse of a tiny range would overflow.
    values = np.rint((to_north_up(heights) - low) / (high - low) * _MAX_GREY)
    _encode(path, values.clip(0, _MAX_GREY).astype(np.uint16), _KEY, record)


def read_png_values(path: Path) -> tuple[NDArray[np.float64], Any]:
    """Read the pixel values of a layer without scaling.

    Returns:
        The values in matrix order, shape (rows, cols), and the record written by
        `write_png_values`, None in other files.

    Raises:
        TerrainError: the file is not a complete 8- or 16-bit greyscale PNG, or its record is
            damaged.
    """
    mode, values, info = _decode(path)
    if mode not in (*_SIXTEEN_BIT, "L"):
        raise TerrainError(
            f"its pixels are {mode!r}, not grey values; export an 8- or 16-bit greyscale PNG"
            " without alpha or palette",
            TerrainErrorCode.UNSUPPORTED,
        )
    text = info.get(_LAYER_KEY)
    try:
        record = None if text is None else json.loads(text)
        if not (record is None or isinstance(record, dict)):
            raise TypeError("not an object")
    except (ValueError, TypeError, RecursionError) as error:
        raise TerrainError(
            f"its text chunk {_LAYER_KEY!r} is damaged ({error}); remove the chunk",
            TerrainErrorCode.INVALID_FILE,
        ) from error
    return matrix_from_north_up(values), record


def write_png_values(path: Path, values: NDArray[np.uint8], record: dict[str, Any]) -> None:
    """Write a layer, shape (rows, cols) in matrix order, as 8-bit grey, and a record as text."""
    _encode(path, to_north_up(values), _LAYER_KEY, record)


def validate_height_range(height_range: Any) -> tuple[float, float]:
    """Return a height range as (low, high) [m].

    Raises:
        TerrainError: it is not two finite numbers, low below high.
    """
    try:
        low, high = (float(value) for value in height_range)
    except (TypeError, ValueError):
        low = high = math.nan
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise TerrainError(
            f"height_range is {height_range!r}; give (low, high) in metres, low below high",
            TerrainErrorCode.HEIGHT_RANGE,
        )
    return low, high


def _encode(path: Path, picture: NDArray[np.unsignedinteger], key: str, record: Any) -> None:
    """Write grey values, shape (height, width), and a record as a text chunk."""
    from PIL import Image, PngImagePlugin  # here: 4 MB that a node without a PNG does not need

    chunk = PngImagePlugin.PngInfo()
    chunk.add_itxt(key, json.dumps(record))
    Image.fromarray(np.ascontiguousarray(picture)).save(path, format="PNG", pnginfo=chunk)


def _decode(path: Path) -> tuple[str, NDArray[np.float64], dict[Any, Any]]:
    """Return mode (of Pillow), values, shape (height, width[, channels]), and text chunks."""
    from PIL import Image

    try:
        with Image.open(path, formats=["PNG"]) as image:
            image.verify()  # checks all checksums; the image must be opened again afterwards
        with Image.open(path, formats=["PNG"]) as image:
            return image.mode, np.asarray(image, dtype=np.float64), image.info
    except Exception as error:  # Pillow has no common base class for errors of damaged files
        raise TerrainError(
            f"it is not a complete PNG ({error}); export it again", TerrainErrorCode.INVALID_FILE
        ) from error


def _parse_record(text: Any) -> Any:
    """Return the record of a text chunk written by `write_png`, None without one."""
    if text is None:
        return None
    try:
        record = json.loads(text)
        Georeference(**(record["georeference"] or {"crs": "", "easting": 0, "northing": 0}))
        cell = record["cell"]
        if isinstance(cell, bool) or not isinstance(cell, (int, float)):
            raise TypeError("cell is not a number")
        record["cell"] = float(cell)
        validate_height_range(record["height_range"])
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        raise TerrainError(
            f"its text chunk {_KEY!r} is damaged ({error}); remove the chunk and give cell and"
            " height_range",
            TerrainErrorCode.INVALID_FILE,
        ) from error
    return record
