"""Terrain as an ESRI ASCII grid: a header of keys, then the rows from north to south.

The format has no coordinate reference system, so the crs of a georeference is lost. Each row of
the grid must be one line, so that the error for a missing value names its line. A file truncated
within the digits of its last value cannot be distinguished from a complete one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.height_map import HeightMap, validated_elevations
from soil_sim.terrain.north_up import matrix_from_north_up, to_north_up
from soil_sim.terrain.raster import TerrainRaster

__all__ = ["read_ascii_grid", "write_ascii_grid", "write_ascii_values"]

_KEYS = (
    "ncols",
    "nrows",
    "xllcorner",
    "xllcenter",
    "yllcorner",
    "yllcenter",
    "cellsize",
    "nodata_value",
)
_NODATA = -9999.0
"""Nodata value of files that do not declare one."""

_Lines = Iterator[tuple[int, list[str]]]
"""Line numbers from 1, and the words of the line."""


def read_ascii_grid(path: Path, *, keep_nodata: bool = False) -> TerrainRaster:
    """Read a grid; its coordinates must be in metres.

    Args:
        path: the file.
        keep_nodata: whether missing values become NaN; otherwise they are rejected.

    Raises:
        TerrainError: a line is invalid or keys are missing; the message names them.
    """
    try:
        text = path.read_text(encoding="ascii")
    except UnicodeDecodeError as error:
        raise TerrainError(
            f"byte {error.start} is not ASCII; save it as plain text", TerrainErrorCode.INVALID_FILE
        ) from error
    lines = ((n, words) for n, line in enumerate(text.splitlines(), 1) if (words := line.split()))
    header, first = _read_header(lines)
    cols, rows = _parse_count(header, "ncols"), _parse_count(header, "nrows")
    cell = header["cellsize"]
    if not cell > 0.0:
        raise TerrainError(
            f"cellsize is {cell:g}; give a positive spacing in metres", TerrainErrorCode.CELL_SIZE
        )
    picture, numbers = _read_rows(first, lines, rows, cols)
    empty = picture == header.get("nodata_value", _NODATA)
    if empty.any() and not keep_nodata:
        row, col = np.argwhere(empty)[0]
        raise TerrainError(
            f"line {numbers[row]}, value {col + 1} is {picture[row, col]:g}, the nodata value;"
            f" {empty.sum()} of {empty.size} cells have no height: fill or crop them",
            TerrainErrorCode.HEIGHT,
        )
    picture[empty] = np.nan
    easting = _center_coordinate(header, "xll", cols * cell, cell)
    northing = _center_coordinate(header, "yll", rows * cell, cell)
    is_at_origin = abs(easting) < 1e-9 * cell and abs(northing) < 1e-9 * cell
    georeference = None if is_at_origin else Georeference("", easting, northing)
    return TerrainRaster(matrix_from_north_up(picture), cell, georeference)


def write_ascii_grid(path: Path, height_map: HeightMap) -> None:
    """Write elevations with all digits; a map without georeference is centred on (0, 0)."""
    write_ascii_values(
        path, validated_elevations(height_map), height_map.grid.cell, height_map.georeference
    )


def write_ascii_values(
    path: Path, values: NDArray[Any], cell: float, georeference: Georeference | None
) -> None:
    """Write numbers, shape (rows, cols) in matrix order, none of them -9999, with all digits."""
    picture = to_north_up(values)
    rows, cols = picture.shape
    place = georeference or Georeference("", 0.0, 0.0)
    header = (
        f"ncols {cols}\nnrows {rows}\n"
        f"xllcorner {place.easting - 0.5 * cols * cell!r}\n"
        f"yllcorner {place.northing - 0.5 * rows * cell!r}\n"
        f"cellsize {float(cell)!r}\nNODATA_value {_NODATA:g}\n"
    )
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(header)
        for row in picture:
            file.write(" ".join(map(repr, row.tolist())) + "\n")


def _read_header(lines: _Lines) -> tuple[dict[str, float], tuple[int, list[str]]]:
    """Return the values of the keys, and the first line without a key."""
    header: dict[str, float] = {}
    first: tuple[int, list[str]] = (0, [])
    for number, words in lines:
        first = (number, words)
        key = words[0].lower()
        if not (key[0].isalpha() or key[0] == "_") or key in ("nan", "inf", "infinity"):
            break
        if key not in _KEYS:
            raise TerrainError(
                f"line {number} has the key {words[0]!r}; give one of {', '.join(_KEYS)}"
                " (cells must be square)",
                TerrainErrorCode.KEYS,
            )
        if key in header or len(words) != 2:
            raise TerrainError(
                f"line {number} must be {key} and one number, given once", TerrainErrorCode.KEYS
            )
        header[key] = _parse_number(words[1], f"line {number}, {key}")
        first = (number, [])
    missing = [key for key in ("ncols", "nrows", "cellsize") if key not in header]
    missing += [
        f"{axis}corner or {axis}center"
        for axis in ("xll", "yll")
        if f"{axis}corner" not in header and f"{axis}center" not in header
    ]
    if missing:
        raise TerrainError(f"its header lacks {', '.join(missing)}; add it", TerrainErrorCode.KEYS)
    for axis in ("xll", "yll"):
        if f"{axis}corner" in header and f"{axis}center" in header:
            raise TerrainError(
                f"its header has {axis}corner and {axis}center; keep one of them",
                TerrainErrorCode.KEYS,
            )
    return header, first


def _read_rows(
    first: tuple[int, list[str]], lines: _Lines, rows: int, cols: int
) -> tuple[NDArray[np.float64], list[int]]:
    """Return the values, shape (rows, cols), row 0 north, and the line number of each row."""
    picture: list[NDArray[np.float64]] = []
    numbers: list[int] = []
    number, words = first
    while words:
        if len(words) != cols:
            raise TerrainError(
                f"line {number} has {len(words)} values, not ncols = {cols}; write each row of"
                " the grid on one line",
                TerrainErrorCode.INVALID_FILE,
            )
        picture.append(np.array([_parse_number(word, f"line {number}") for word in words]))
        numbers.append(number)
        number, words = next(lines, (0, []))
    if len(picture) != rows:
        raise TerrainError(
            f"it has {len(picture)} rows of values, not nrows = {rows}; if it was cut off, copy"
            " it again",
            TerrainErrorCode.INVALID_FILE,
        )
    return np.stack(picture), numbers


def _parse_number(word: str, where: str) -> float:
    try:
        value = float(word) if "_" not in word else math.nan  # Python reads 1_0 as 10
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TerrainError(
            f"{where} has {word!r}; give a finite number with a decimal point",
            TerrainErrorCode.INVALID_FILE,
        )
    return value


def _parse_count(header: dict[str, float], key: str) -> int:
    value = header[key]
    if not (value.is_integer() and value >= 2):
        raise TerrainError(
            f"{key} is {value:g}; give a whole number, at least 2", TerrainErrorCode.SHAPE
        )
    return int(value)


def _center_coordinate(header: dict[str, float], axis: str, extent: float, cell: float) -> float:
    """Return easting or northing of the centre of the grid [m] from its south-west cell."""
    if f"{axis}corner" in header:
        return header[f"{axis}corner"] + 0.5 * extent
    return header[f"{axis}center"] + 0.5 * (extent - cell)
