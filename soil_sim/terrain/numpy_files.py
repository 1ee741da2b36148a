"""Terrain as NumPy files, in matrix order: `.npy` holds heights only, `.npz` the whole map.

An `.npz` has `heights` [m], shape (rows, cols), and `cell` [m], and for ground that lies somewhere
also `crs`, `easting`, `northing` and `elevation`, as in `Georeference`. It may have the layers
`soil` and `moisture` beside them, or alone. Nothing is unpickled.
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

from soil_sim.errors import TerrainError
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.height_map import HeightMap, as_height_array
from soil_sim.terrain.raster import TerrainRaster

__all__ = ["LAYER_NAMES", "NpzContents", "read_npy", "read_npz", "write_npy", "write_npz"]

LAYER_NAMES = ("soil", "moisture")
"""What layers are called, in archives and elsewhere."""

_REQUIRED = ("heights", "cell")
_GEOREFERENCE_KEYS = ("crs", "easting", "northing", "elevation")

# What NumPy and the zip reader raise on broken bytes; an OSError is the caller's.
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
    """What an `.npz` holds.

    Attributes:
        heights: [m], shape (rows, cols), or None for an archive of layers alone.
        cell: spacing [m]; None where an archive of layers alone states none.
        georeference: where the ground lies, None where the archive does not say.
        layers: the layers' values by name, shape (rows, cols) in float64.
    """

    heights: NDArray[np.float64] | None
    cell: float | None
    georeference: Georeference | None
    layers: dict[str, NDArray[np.float64]]


def read_npy(path: Path, what: str = "heights") -> TerrainRaster:
    """Read one array; `what` is its name in errors.

    Raises:
        TerrainError: no complete array of real numbers, at least 2 x 2.
    """
    try:
        # Mapped, so that a header that promises more than the file holds is found at once.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except _READ_ERRORS as error:
        raise TerrainError(
            f"it holds no complete array of numbers ({error}); write it again with numpy.save"
        ) from error
    if not isinstance(array, np.ndarray):
        array.close()
        raise TerrainError("it is an archive of arrays; give it the suffix .npz")
    return TerrainRaster(as_height_array(array, what).copy())


def read_npz(path: Path, *, require_heights: bool = True) -> NpzContents:
    """Read a whole map and its layers.

    Args:
        path: the file.
        require_heights: whether heights and cell must be there.

    Raises:
        TerrainError: a damaged archive, an array missing, unknown or of the wrong kind.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (*_READ_ERRORS, AttributeError, TypeError) as error:
        raise TerrainError(
            f"it holds no complete archive of numbers ({error}); write it with numpy.savez"
        ) from error
    _check_names(arrays, require_heights)
    place = None
    if any(name in arrays for name in _GEOREFERENCE_KEYS):
        place = Georeference(*(_scalar(name, arrays[name]) for name in _GEOREFERENCE_KEYS))
    heights, cell = arrays.get("heights"), arrays.get("cell")
    return NpzContents(
        None if heights is None else as_height_array(heights),
        None if cell is None else _number("cell", cell),
        place,
        {
            name: as_height_array(arrays[name], f"values of {name}")
            for name in LAYER_NAMES
            if name in arrays
        },
    )


def write_npy(path: Path, height_map: HeightMap) -> None:
    """Write the heights; spacing and georeference have no room in the format."""
    np.save(path, height_map.heights, allow_pickle=False)


def write_npz(
    path: Path, cell: float, georeference: Georeference | None, arrays: dict[str, NDArray[Any]]
) -> None:
    """Write arrays, shape (rows, cols), under their names, with spacing [m] and place."""
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
            f"it holds the arrays {', '.join(arrays) or 'none'}; give it {', '.join(_REQUIRED)}"
            f" and, for georeferenced ground, {', '.join(_GEOREFERENCE_KEYS)}, for layers"
            f" {', '.join(LAYER_NAMES)}, and nothing else"
        )


def _scalar(name: str, array: Any) -> Any:
    """A text or number as Python has it."""
    if np.ndim(array) != 0 or array.dtype.kind not in "iufU":
        raise TerrainError(f"{name} is {array!r}; give one number (for crs, one text)")
    return array.item()


def _number(name: str, array: Any) -> float:
    value = _scalar(name, array)
    if isinstance(value, str):
        raise TerrainError(f"{name} is {value!r}; give a number of metres")
    return float(value)
