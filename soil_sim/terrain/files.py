"""Read and write terrain files of all formats; a file with an invalid height is rejected.

| suffix | order | spacing | keeps the georeference |
|---|---|---|---|
| `.npy` | matrix | from the caller | no |
| `.npz` | matrix | in the file | yes |
| `.png` 16-bit grey | north-up image | from the caller or a text chunk | in the text chunk |
| `.asc` ESRI ASCII grid | north-up image | in the file | yes, but not its crs |
| `.tif`, `.tiff` GeoTIFF | north-up image | in the file | yes |

Heights are written in metres. The text chunk of a `.png` states the heights of its grey values 0
and 65535, so that it is read without arguments. `.asc` and `.tif` store elevations and declare
-9999 as nodata. A `.tif` also stores the elevation of z = 0; a map from an `.asc` has elevations
as heights. An `.npz` can also store `layers`. `north_up` describes the orders of cells.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError, TerrainErrorCode
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
    """Read the height map of a file.

    Args:
        path: file with a suffix of `SUFFIXES`.
        cell: spacing [m], for files that do not state one. If it differs from the spacing of the
            file, the terrain is stretched and has no georeference.
        vertical_scale: metres per unit of the heights in the file, 0.3048 for feet.
        height_range: heights of the values 0 and 65535 of a `.png`, in the unit of the file.

    Raises:
        TerrainError: the file is missing, damaged or of an unknown format, an argument it needs is
            missing or invalid, or a height is invalid. The message starts with the path.
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
    """Read the height map and the layers of an `.npz`.

    Args:
        path: file with the suffix `.npz`; `load_layer` reads layers of other files.
        cell: spacing [m], see `load_terrain`.
        vertical_scale: metres per unit of the heights in the file.

    Raises:
        TerrainError: as of `load_terrain`, or a layer has another shape than the heights, or
            missing or invalid values.
    """
    path = Path(path)
    height_map = load_terrain(path, cell=cell, vertical_scale=vertical_scale)
    with wrap_read_errors(path):
        if validate_suffix(path) != ".npz":
            raise TerrainError(
                "its format cannot store layers; give an .npz, or use load_layer",
                TerrainErrorCode.UNSUPPORTED,
            )
        arrays = read_npz(path).layers
        return height_map, layers_from_arrays(arrays, height_map.grid.shape)


def load_heights_with_nodata(
    path: str | os.PathLike[str],
    *,
    cell: float | None = None,
    vertical_scale: float = 1.0,
    height_range: HeightRange | None = None,
) -> tuple[Grid, NDArray[np.float64], Georeference | None]:
    """Read heights that may be missing in some cells, as those of a design.

    Args:
        path, cell, vertical_scale, height_range: as for `load_terrain`.

    Returns:
        The grid, heights [m], shape (rows, cols), NaN where missing, and the georeference.

    Raises:
        TerrainError: as of `load_terrain`, except for missing heights.
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
    """Write a height map; an existing file is replaced only by a complete one.

    Args:
        path: file with a suffix of `SUFFIXES`, in an existing folder.
        height_map: the map to write.
        height_range: heights [m] of the values 0 and 65535 of a `.png`; None takes the lowest and
            highest height of the map.
        layers: layers to write into the same file, `.npz` only.

    Raises:
        TerrainError: the suffix is unknown, the folder is not writable, or the format cannot store
            the map or the layers. The message starts with the path.
    """
    path = Path(path)
    with atomic_write(path) as part:
        suffix = validate_suffix(path)
        _check_arguments(suffix, None, 1.0, height_range)
        if layers is not None and suffix != ".npz":
            raise TerrainError(
                "only .npz stores layers; write each with save_layer", TerrainErrorCode.UNSUPPORTED
            )
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
    """Return grid, heights [m] and georeference of a raster."""
    if cell is None:
        cell = reading.cell
    if cell is None:
        raise TerrainError("it states no spacing in metres; give cell", TerrainErrorCode.CELL_SIZE)
    is_stretched = reading.cell is None or not math.isclose(cell, reading.cell)
    heights = reading.heights * vertical_scale
    grid = Grid(heights.shape[0], heights.shape[1], cell)
    return grid, heights, None if is_stretched else reading.georeference


def _check_arguments(
    suffix: str, cell: float | None, vertical_scale: float, height_range: HeightRange | None
) -> None:
    if cell is not None and not _is_positive_number(cell):
        raise TerrainError(
            f"cell is {cell!r}; give a positive spacing in metres", TerrainErrorCode.CELL_SIZE
        )
    if not _is_positive_number(vertical_scale):
        raise TerrainError(
            f"vertical_scale is {vertical_scale!r}; give a positive number",
            TerrainErrorCode.ARGUMENT,
        )
    if height_range is not None and suffix != ".png":
        raise TerrainError(
            "height_range applies to .png only; leave it out", TerrainErrorCode.ARGUMENT
        )


def _is_positive_number(value: object) -> bool:
    is_real = isinstance(value, (int, float)) and not isinstance(value, bool)
    return is_real and 0.0 < float(value) < math.inf  # type: ignore[arg-type]
