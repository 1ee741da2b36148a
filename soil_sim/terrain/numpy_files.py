"""Terrain as NumPy files, in matrix order: `.npy` holds heights only, `.npz` the whole map.

An `.npz` has `heights` [m], shape (rows, cols), and `cell` [m], and for ground that lies somewhere
also `crs`, `easting`, `northing` and `elevation`, as in `Georeference`. Nothing is unpickled.
"""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from soil_sim.errors import TerrainError
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.heights import HeightMap, height_array
from soil_sim.terrain.reading import Reading

__all__ = ["read_npy", "read_npz", "write_npy", "write_npz"]

_REQUIRED = ("heights", "cell")
_PLACE = ("crs", "easting", "northing", "elevation")

# What NumPy and the zip reader raise on broken bytes; an OSError is the caller's.
_BROKEN = (
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


def read_npy(path: Path) -> Reading:
    """Read one array.

    Raises:
        TerrainError: no complete array of real numbers, at least 2 x 2.
    """
    try:
        # Mapped, so that a header that promises more than the file holds is found at once.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except _BROKEN as error:
        raise TerrainError(
            f"it holds no complete array of numbers ({error}); write it again with numpy.save"
        ) from error
    if not isinstance(array, np.ndarray):
        array.close()
        raise TerrainError("it is an archive of arrays; give it the suffix .npz")
    return Reading(height_array(array).copy())


def read_npz(path: Path) -> Reading:
    """Read a whole map.

    Raises:
        TerrainError: a damaged archive, an array missing, unknown or of the wrong kind.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (*_BROKEN, AttributeError, TypeError) as error:
        raise TerrainError(
            f"it holds no complete archive of numbers ({error}); write it with numpy.savez"
        ) from error
    _check_names(arrays)
    place = None
    if any(name in arrays for name in _PLACE):
        place = Georeference(*(_single(name, arrays[name]) for name in _PLACE))
    return Reading(height_array(arrays["heights"]), _number("cell", arrays["cell"]), place)


def write_npy(path: Path, height_map: HeightMap) -> None:
    """Write the heights; spacing and georeference have no room in the format."""
    np.save(path, height_map.heights, allow_pickle=False)


def write_npz(path: Path, height_map: HeightMap) -> None:
    """Write the whole map."""
    arrays: dict[str, Any] = {"heights": height_map.heights, "cell": height_map.grid.cell}
    if height_map.georeference is not None:
        arrays.update({name: getattr(height_map.georeference, name) for name in _PLACE})
    np.savez_compressed(path, **arrays)


def _check_names(arrays: dict[str, Any]) -> None:
    known = _REQUIRED + _PLACE
    wanted = known if any(name in arrays for name in _PLACE) else _REQUIRED
    missing = [name for name in wanted if name not in arrays]
    unknown = [name for name in arrays if name not in known]
    if missing or unknown:
        raise TerrainError(
            f"it holds the arrays {', '.join(arrays) or 'none'}; give it {', '.join(_REQUIRED)}"
            f" and, for georeferenced ground, {', '.join(_PLACE)}, and nothing else"
        )


def _single(name: str, array: Any) -> Any:
    """A text or number as Python has it."""
    if np.ndim(array) != 0 or array.dtype.kind not in "iufU":
        raise TerrainError(f"{name} is {array!r}; give one number (for crs, one text)")
    return array.item()


def _number(name: str, array: Any) -> float:
    value = _single(name, array)
    if isinstance(value, str):
        raise TerrainError(f"{name} is {value!r}; give a number of metres")
    return float(value)
