"""Terrain as NumPy files, in matrix order: `.npy` stores heights only, `.npz` the whole map.

An `.npz` has `heights` [m], shape (rows, cols), and `cell` [m], and for georeferenced terrain also
`crs`, `easting`, `northing` and `elevation`, as in `Georeference`. It can also have the layers
`soil` (ids) and `moisture` [% of saturation], with or without heights. Nothing is unpickled.
"""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.height_map import HeightMap, as_height_array
from soil_sim.terrain.raster import TerrainRaster

__all__ = ["LAYER_NAMES", "NpzContents", "read_npy", "read_npz", "write_npy", "write_npz"]

LAYER_NAMES = ("soil", "moisture")
"""Names of the layers."""

_REQUIRED = ("heights", "cell")
_GEOREFERENCE_KEYS = ("crs", "easting", "northing", "elevation")

# Errors of NumPy and the zip reader on damaged files; the caller handles OSError.
_READ_ERRORS = (
    ValueError,
    EOFError,
    KeyError,
    SyntaxError,
    RuntimeError,
    struct.error,
    tokenize.TokenError,
    zlib.error,
    zipfile.BadZipFile,
)


class NpzContents(NamedTuple):
    """Contents of an `.npz`.

    Attributes:
        heights: heights [m], shape (rows, cols), or None in an archive of layers only.
        cell: spacing [m], or None in an archive of layers without it.
        georeference: georeference, None without one.
        layers: values of the layers by name, shape (rows, cols), float64.
    """

    heights: NDArray[np.float64] | None
    cell: float | None
    georeference: Georeference | None
    layers: dict[str, NDArray[np.float64]]


def read_npy(path: Path, what: str = "heights") -> TerrainRaster:
    """Read one array; `what` is its name in errors.

    Raises:
        TerrainError: the file is not a complete array of real numbers, at least 2 x 2.
    """
    try:
        # Memory-mapped: a header with a size beyond the end of the file raises at once.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (*_READ_ERRORS, TypeError) as error:
        raise TerrainError(
            f"it has no complete array of numbers ({error}); write it again with numpy.save",
            TerrainErrorCode.INVALID_FILE,
        ) from error
    if not isinstance(array, np.ndarray):
        array.close()
        raise TerrainError(
            "it is an archive of arrays; give it the suffix .npz", TerrainErrorCode.INVALID_FILE
        )
    return TerrainRaster(as_height_array(array, what).copy())


def read_npz(path: Path, *, require_heights: bool = True) -> NpzContents:
    """Read a whole map and its layers.

    Args:
        path: the file.
        require_heights: whether heights and cell are required.

    Raises:
        TerrainError: the archive is damaged, or an array is missing, unknown or invalid.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (*_READ_ERRORS, AttributeError, TypeError) as error:
        raise TerrainError(
            f"it is not a complete archive of numbers ({error}); write it with numpy.savez",
            TerrainErrorCode.INVALID_FILE,
        ) from error
    _check_names(arrays, require_heights)
    place = None
    if any(name in arrays for name in _GEOREFERENCE_KEYS):
        place = Georeference(*(_scalar(name, arrays[name]) for name in _GEOREFERENCE_KEYS))
    heights, cell = arrays.get("heights"), arrays.get("cell")
    return NpzContents(
        None if heights is None else as_height_array(heights),
        None if cell is None else _cell_size(cell),
        place,
        {
            name: as_height_array(arrays[name], f"values of {name}")
            for name in LAYER_NAMES
            if name in arrays
        },
    )


def write_npy(path: Path, height_map: HeightMap) -> None:
    """Write the heights; the format cannot store spacing and georeference."""
    np.save(path, height_map.heights, allow_pickle=False)


def write_npz(
    path: Path, cell: float, georeference: Georeference | None, arrays: dict[str, NDArray[Any]]
) -> None:
    """Write named arrays, shape (rows, cols), with spacing [m] and georeference."""
    entries: dict[str, Any] = {**arrays, "cell": cell}
    if georeference is not None:
        entries.update({name: getattr(georeference, name) for name in _GEOREFERENCE_KEYS})
    np.savez_compressed(path, **entries)


def _check_names(arrays: dict[str, Any], require_heights: bool) -> None:
    required = _REQUIRED if require_heights or "heights" in arrays else ()
    wanted = required + (
        _GEOREFERENCE_KEYS if any(name in arrays for name in _GEOREFERENCE_KEYS) else ()
    )
    missing = [name for name in wanted if name not in arrays]
    known = _REQUIRED + _GEOREFERENCE_KEYS + LAYER_NAMES
    unknown = [name for name in arrays if name not in known]
    if missing or unknown:
        raise TerrainError(
            f"it has the arrays {', '.join(arrays) or 'none'}; give it {', '.join(_REQUIRED)}"
            f" and, for georeferenced ground, {', '.join(_GEOREFERENCE_KEYS)}, for layers"
            f" {', '.join(LAYER_NAMES)}, and nothing else",
            TerrainErrorCode.KEYS,
        )


def _scalar(name: str, array: Any) -> Any:
    """Return a scalar array as a Python text or number."""
    if np.ndim(array) != 0 or array.dtype.kind not in "iufU":
        code = TerrainErrorCode.CELL_SIZE if name == "cell" else TerrainErrorCode.GEOREFERENCE
        raise TerrainError(f"{name} is {array!r}; give one number (for crs, one text)", code)
    return array.item()


def _cell_size(array: Any) -> float:
    value = _scalar("cell", array)
    if isinstance(value, str):
        raise TerrainError(
            f"cell is {value!r}; give a number of metres", TerrainErrorCode.CELL_SIZE
        )
    return float(value)
