"""Terrain from files and back, by suffix; a file that cannot be ground is refused whole.

| suffix | order | spacing | keeps the georeference |
|---|---|---|---|
| `.npy` | matrix | from the caller | no |
| `.npz` | matrix | in the file | yes |
| `.png` 16-bit grey | north-up picture | from the caller, or the text we add | in the text |
| `.asc` ESRI ASCII grid | north-up picture | in the file | yes, but not its crs |
| `.tif`, `.tiff` GeoTIFF | north-up picture | in the file | yes |

`.asc` and `.tif` hold elevations: a map whose z = 0 is not at the datum comes back with its
heights as elevations. `north_up` says how picture and matrix order relate.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError
from soil_sim.terrain.ascii_grid import read_ascii_grid, write_ascii_grid
from soil_sim.terrain.geotiff import read_geotiff, write_geotiff
from soil_sim.terrain.heights import HeightMap
from soil_sim.terrain.numpy_files import read_npy, read_npz, write_npy, write_npz
from soil_sim.terrain.png import read_png, write_png
from soil_sim.terrain.reading import Reading

__all__ = ["SUFFIXES", "load_terrain", "save_terrain"]

SUFFIXES = (".npy", ".npz", ".png", ".asc", ".tif", ".tiff")
"""What files of terrain are called."""

HeightRange = tuple[float, float]


def load_terrain(
    path: str | os.PathLike[str],
    *,
    cell: float | None = None,
    vertical_scale: float = 1.0,
    height_range: HeightRange | None = None,
) -> HeightMap:
    """The map in a file.

    Args:
        path: a file with one of `SUFFIXES`.
        cell: spacing [m], for files that state none. Given for a file that states another, it
            stretches the ground, which then has no georeference.
        vertical_scale: metres per unit of the file's heights, 0.3048 for a file in feet.
        height_range: heights of the values 0 and 65535 of a `.png`, in the file's unit.

    Raises:
        TerrainError: the file is missing, damaged or of an unknown kind, an argument it needs is
            missing or wrong, or its heights cannot be ground. The message starts with the path.
    """
    path = Path(path)
    try:
        suffix = _suffix(path)
        _check_arguments(suffix, cell, vertical_scale, height_range)
        if not path.is_file():
            raise TerrainError("there is no such file; give the path of a terrain file")
        reading = _read(path, suffix, cell is not None, height_range)
        return _map(reading, cell, vertical_scale)
    except EarthmovingError as error:
        raise TerrainError(f"{path}: {error}") from error
    except OSError as error:
        raise TerrainError(f"{path}: it cannot be read ({error}); check the file") from error
    except MemoryError as error:
        raise TerrainError(f"{path}: it does not fit into memory; crop it first") from error


def save_terrain(
    path: str | os.PathLike[str],
    height_map: HeightMap,
    *,
    height_range: HeightRange | None = None,
) -> None:
    """Write a map; a file already there is replaced only by a complete one.

    Args:
        path: a file with one of `SUFFIXES`; its folder must exist.
        height_map: what to write.
        height_range: heights [m] of the values 0 and 65535 of a `.png`; None takes the map's
            lowest and highest.

    Raises:
        TerrainError: unknown suffix, a folder that cannot be written to, or a map the format
            cannot hold. The message starts with the path.
    """
    path = Path(path)
    try:
        suffix = _suffix(path)
        _check_arguments(suffix, None, 1.0, height_range)
        with _replacing(path) as part:
            _write(part, suffix, height_map, height_range)
    except EarthmovingError as error:
        raise TerrainError(f"{path}: {error}") from error
    except OSError as error:
        raise TerrainError(
            f"{path}: it cannot be written ({error}); give a folder that exists and is yours"
        ) from error


def _read(path: Path, suffix: str, cell_given: bool, height_range: HeightRange | None) -> Reading:
    if suffix == ".npy":
        return read_npy(path)
    if suffix == ".npz":
        return read_npz(path)
    if suffix == ".png":
        return read_png(path, height_range)
    if suffix == ".asc":
        return read_ascii_grid(path)
    return read_geotiff(path, cell_given=cell_given)


def _write(
    path: Path, suffix: str, height_map: HeightMap, height_range: HeightRange | None
) -> None:
    if suffix == ".npy":
        write_npy(path, height_map)
    elif suffix == ".npz":
        write_npz(path, height_map)
    elif suffix == ".png":
        write_png(path, height_map, height_range)
    elif suffix == ".asc":
        write_ascii_grid(path, height_map)
    else:
        write_geotiff(path, height_map)


def _map(reading: Reading, cell: float | None, vertical_scale: float) -> HeightMap:
    if cell is None:
        cell = reading.cell
    if cell is None:
        raise TerrainError("it states no spacing in metres; give cell")
    stretched = reading.cell is None or not math.isclose(cell, reading.cell)
    heights = reading.heights * vertical_scale
    grid = Grid(heights.shape[0], heights.shape[1], cell)
    return HeightMap(grid, heights, None if stretched else reading.georeference)


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise TerrainError(f"suffix {path.suffix!r} is unknown; give one of {', '.join(SUFFIXES)}")
    return suffix


def _check_arguments(
    suffix: str, cell: float | None, vertical_scale: float, height_range: HeightRange | None
) -> None:
    if cell is not None and not _positive(cell):
        raise TerrainError(f"cell is {cell!r}; give a positive spacing in metres")
    if not _positive(vertical_scale):
        raise TerrainError(f"vertical_scale is {vertical_scale!r}; give a positive number")
    if height_range is not None and suffix != ".png":
        raise TerrainError("height_range is for .png only; leave it out")


def _positive(value: object) -> bool:
    real = isinstance(value, (int, float)) and not isinstance(value, bool)
    return real and 0.0 < float(value) < math.inf  # type: ignore[arg-type]


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """A file beside `path` that takes its place when the block ends well."""
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix.lower()}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
