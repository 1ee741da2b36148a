"""Terrain from files and back, by suffix; a file that cannot be ground is refused whole.

| suffix | order | spacing | keeps the georeference |
|---|---|---|---|
| `.npy` | matrix | from the caller | no |
| `.npz` | matrix | in the file | yes |
| `.png` 16-bit grey | north-up picture | from the caller, or the text we add | in the text |
| `.asc` ESRI ASCII grid | north-up picture | in the file | yes, but not its crs |
| `.tif`, `.tiff` GeoTIFF | north-up picture | in the file | yes |

All write metres. A `.png` says in its text which heights its grey values 0 and 65535 are, and comes
back without being told. `.asc` and `.tif` hold elevations and declare -9999 as their mark of
missing ones. A `.tif` also says where z = 0 lies and comes back as it was; from an `.asc` a map
whose z = 0 is not at the datum comes back with its heights as elevations. An `.npz` can hold
`layers` too. `north_up` says how picture and matrix order relate.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError
from soil_sim.terrain.ascii_grid import read_ascii_grid, write_ascii_grid
from soil_sim.terrain.file_access import (
    SUFFIXES,
    atomic_write,
    check_file_exists,
    validate_suffix,
    wrap_read_errors,
)
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.geotiff import read_geotiff, write_geotiff
from soil_sim.terrain.height_map import HeightMap
from soil_sim.terrain.layers import Layers, layers_from_arrays
from soil_sim.terrain.numpy_files import read_npy, read_npz, write_npy, write_npz
from soil_sim.terrain.png import read_png, write_png
from soil_sim.terrain.raster import TerrainRaster

__all__ = [
    "SUFFIXES",
    "load_heights_with_nodata",
    "load_terrain",
    "load_terrain_with_layers",
    "save_terrain",
]

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
    with wrap_read_errors(path):
        reading = _read_file(path, cell, vertical_scale, height_range, keep_nodata=False)
        grid, heights, place = _apply_scale(reading, cell, vertical_scale)
        return HeightMap(grid, heights, place)


def load_terrain_with_layers(
    path: str | os.PathLike[str],
    *,
    cell: float | None = None,
    vertical_scale: float = 1.0,
) -> tuple[HeightMap, Layers]:
    """The map in an `.npz`, and the layers that are beside it there.

    Args:
        path: a file with the suffix `.npz`; layers of other files are read by `load_layer`.
        cell: spacing [m], see `load_terrain`.
        vertical_scale: metres per unit of the file's heights.

    Raises:
        TerrainError: as `load_terrain`, or a layer that is not of the shape of the heights or
            has cells that are missing or cannot be.
    """
    path = Path(path)
    height_map = load_terrain(path, cell=cell, vertical_scale=vertical_scale)
    with wrap_read_errors(path):
        if validate_suffix(path) != ".npz":
            raise TerrainError("it has no room for layers; give an .npz, or use load_layer")
        arrays = read_npz(path).layers
        return height_map, layers_from_arrays(arrays, height_map.grid.shape)


def load_heights_with_nodata(
    path: str | os.PathLike[str],
    *,
    cell: float | None = None,
    vertical_scale: float = 1.0,
    height_range: HeightRange | None = None,
) -> tuple[Grid, NDArray[np.float64], Georeference | None]:
    """Heights that need not be everywhere, as those of a design.

    Args:
        path, cell, vertical_scale, height_range: as for `load_terrain`.

    Returns:
        The grid, heights [m], shape (rows, cols), NaN where the file has none, and the place.

    Raises:
        TerrainError: as `load_terrain`, but for missing heights.
    """
    path = Path(path)
    with wrap_read_errors(path):
        reading = _read_file(path, cell, vertical_scale, height_range, keep_nodata=True)
        return _apply_scale(reading, cell, vertical_scale)


def save_terrain(
    path: str | os.PathLike[str],
    height_map: HeightMap,
    *,
    height_range: HeightRange | None = None,
    layers: Layers | None = None,
) -> None:
    """Write a map; a file already there is replaced only by a complete one.

    Args:
        path: a file with one of `SUFFIXES`; its folder must exist.
        height_map: what to write.
        height_range: heights [m] of the values 0 and 65535 of a `.png`; None takes the map's
            lowest and highest.
        layers: to be written beside the heights, `.npz` only.

    Raises:
        TerrainError: unknown suffix, a folder that cannot be written to, or a map or layers the
            format cannot hold. The message starts with the path.
    """
    path = Path(path)
    with atomic_write(path) as part:
        suffix = validate_suffix(path)
        _check_arguments(suffix, None, 1.0, height_range)
        if layers is not None and suffix != ".npz":
            raise TerrainError("layers go into .npz only; write each by save_layer")
        if suffix == ".npy":
            write_npy(part, height_map)
        elif suffix == ".npz":
            arrays = (layers or Layers()).to_npz_arrays(height_map.grid)
            arrays["heights"] = height_map.heights
            write_npz(part, height_map.grid.cell, height_map.georeference, arrays)
        elif suffix == ".png":
            write_png(part, height_map, height_range)
        elif suffix == ".asc":
            write_ascii_grid(part, height_map)
        else:
            write_geotiff(part, height_map)


def _read_file(
    path: Path,
    cell: float | None,
    vertical_scale: float,
    height_range: HeightRange | None,
    *,
    keep_nodata: bool,
) -> TerrainRaster:
    suffix = validate_suffix(path)
    _check_arguments(suffix, cell, vertical_scale, height_range)
    check_file_exists(path)
    if suffix == ".npy":
        return read_npy(path)
    if suffix == ".npz":
        archive = read_npz(path)
        assert archive.heights is not None
        return TerrainRaster(archive.heights, archive.cell, archive.georeference)
    if suffix == ".png":
        return read_png(path, height_range)
    if suffix == ".asc":
        return read_ascii_grid(path, keep_nodata=keep_nodata)
    return read_geotiff(
        path,
        has_cell=cell is not None,
        has_vertical_scale=vertical_scale != 1.0,
        keep_nodata=keep_nodata,
    )


def _apply_scale(
    reading: TerrainRaster, cell: float | None, vertical_scale: float
) -> tuple[Grid, NDArray[np.float64], Georeference | None]:
    """Grid, heights [m] and place of what was read."""
    if cell is None:
        cell = reading.cell
    if cell is None:
        raise TerrainError("it states no spacing in metres; give cell")
    stretched = reading.cell is None or not math.isclose(cell, reading.cell)
    heights = reading.heights * vertical_scale
    grid = Grid(heights.shape[0], heights.shape[1], cell)
    return grid, heights, None if stretched else reading.georeference


def _check_arguments(
    suffix: str, cell: float | None, vertical_scale: float, height_range: HeightRange | None
) -> None:
    if cell is not None and not _is_positive_number(cell):
        raise TerrainError(f"cell is {cell!r}; give a positive spacing in metres")
    if not _is_positive_number(vertical_scale):
        raise TerrainError(f"vertical_scale is {vertical_scale!r}; give a positive number")
    if height_range is not None and suffix != ".png":
        raise TerrainError("height_range is for .png only; leave it out")


def _is_positive_number(value: object) -> bool:
    real = isinstance(value, (int, float)) and not isinstance(value, bool)
    return real and 0.0 < float(value) < math.inf  # type: ignore[arg-type]
