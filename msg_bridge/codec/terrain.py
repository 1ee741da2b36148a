"""The terrain surface as an organised cloud.

It is in the matrix order of grid_map, as the arrays are: height = rows, width = cols, point (0, 0)
at the +x, +y corner, rows toward -x and columns toward -y.

A cloud has no other place for numbers, so `revision` and `run_id` are fields with the same value in
every point. Compared with the field `revision` of map updates they show which updates a keyframe
already contains, in any order of arrival of the two topics. z is the elevation; there is no second
field for it. The other layers are float32, because viewers colour by float32 fields.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.grid_estimation import cell_positions, grid_of_cells
from msg_bridge.codec.point_cloud import allocate_point_cloud, from_point_cloud
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import Rows

__all__ = [
    "DISPLAY_FIELDS",
    "TERRAIN_CELL",
    "TerrainMap",
    "cells_of_terrain",
    "cells_of_terrain_cloud",
    "from_terrain_cloud",
    "keyframe_of_cells",
    "terrain_of_cells",
    "to_terrain_cloud",
]

DISPLAY_FIELDS = (
    ("x", "<f4"),
    ("y", "<f4"),
    ("z", "<f4"),  # elevation [m]
    ("loose_depth", "<f4"),  # depth of loose soil [m]
    ("surface_material", "<f4"),  # 0 undisturbed, 1 excavated, 2 deposited
    ("moisture", "<f4"),  # [% of saturation], 0 to 100
    ("soil", "<f4"),  # id of the soil type at the surface, as in /sim/config
    ("design_difference", "<f4"),  # elevation minus design [m], NaN without a design
)
"""Fields with which the points of terrain clouds begin: position and layers that viewers show."""

TERRAIN_CELL = np.dtype(
    [
        *DISPLAY_FIELDS,
        ("volume_mm3", "<f8"),  # bank volume above the floor; exact: integers below 2**53
        ("rut_depth", "<f4"),  # by which the surface was pressed down [m]
        ("revision", "<u4"),  # the same in every cell
        ("run_id", "<u4"),  # the same in every cell
    ]
)
"""A point of the terrain cloud. Fields have the names of those of MAP_UPDATE rows, which have soil
and moisture as integers."""

_MAX_VOLUME_MM3 = 2**53

_BAND_BYTES = 2**18
"""Size of a band of rows that is encoded at once."""

_MAX_VALUES = {"surface_material": 2, "moisture": 100, "soil": 255}
"""Largest value of each integer layer."""


@dataclass(frozen=True)
class TerrainMap:
    """A keyframe with further layers for display. Arrays have shape (rows, cols).

    Attributes:
        keyframe: the surface; a decoded elevation has float32 precision.
        loose_depth: depth of loose soil [m]; float32 precision when decoded.
        surface_material: appearance of the surface, uint8: 0 undisturbed, 1 excavated, 2 deposited;
            zeros if not given.
        design_difference: elevation minus design [m], float32, NaN without a design; NaN if not
            given.
    """

    keyframe: Keyframe
    loose_depth: NDArray[np.float64]
    surface_material: NDArray[np.uint8] = None  # type: ignore[assignment]
    design_difference: NDArray[np.float32] = None  # type: ignore[assignment]

    @property
    def volume_mm3(self) -> NDArray[np.int64]:
        """Bank volume above the floor [mm^3], exact."""
        return self.keyframe.volume_mm3

    @property
    def soil(self) -> NDArray[np.uint8]:
        """Id of the soil type at the surface."""
        return self.keyframe.soil

    @property
    def rut_depth(self) -> NDArray[np.float32]:
        """Depth by which the surface was pressed down [m]."""
        return self.keyframe.rut_depth

    @property
    def moisture(self) -> NDArray[np.uint8]:
        """Moisture at the surface [% of saturation]."""
        return self.keyframe.moisture

    def __post_init__(self) -> None:
        """Fill in the layers that are not given."""
        shape = self.keyframe.grid.shape
        if self.surface_material is None:
            object.__setattr__(self, "surface_material", np.zeros(shape, dtype=np.uint8))
        if self.design_difference is None:
            no_design = np.full(shape, np.nan, dtype=np.float32)
            object.__setattr__(self, "design_difference", no_design)


def to_terrain_cloud(terrain: TerrainMap, frame_id: str, stamp: Time) -> PointCloud2:
    """Encode a terrain as an organised cloud of TERRAIN_CELL points.

    Raises:
        CodecError: SHAPE; VALUE: a value outside the range of its field.
    """
    _check_terrain(terrain)
    grid = terrain.keyframe.grid
    msg, points = allocate_point_cloud(
        grid.rows * grid.cols, TERRAIN_CELL, frame_id, stamp, height=grid.rows
    )
    _write_cells(terrain, points.reshape(grid.shape))
    return msg


def cells_of_terrain(terrain: TerrainMap) -> Rows:
    """Return the points of `to_terrain_cloud`, shape (rows, cols).

    Raises:
        CodecError: as `to_terrain_cloud`.
    """
    _check_terrain(terrain)
    cells: Rows = np.empty(terrain.keyframe.grid.shape, dtype=TERRAIN_CELL)
    _write_cells(terrain, cells)
    return cells


def _check_terrain(terrain: TerrainMap) -> None:
    """Check that a terrain can be encoded.

    Raises:
        CodecError: SHAPE or VALUE.
    """
    frame = terrain.keyframe
    grid, volume = frame.grid, terrain.volume_mm3
    for name, layer in (
        ("elevation", frame.elevation),
        ("loose_depth", terrain.loose_depth),
        ("volume_mm3", volume),
        ("design_difference", terrain.design_difference),
        ("rut_depth", terrain.rut_depth),
        *((name, getattr(terrain, name)) for name in _MAX_VALUES),
    ):
        if layer.shape != grid.shape:
            raise CodecError(
                f"{name} has shape {layer.shape} on a grid of {grid.shape}", ErrorCode.SHAPE
            )
    for name, max_value in _MAX_VALUES.items():
        layer = getattr(terrain, name)
        if layer.dtype != np.uint8 or layer.max() > max_value:
            raise CodecError(
                f"{name} is of type {layer.dtype} with values up to {layer.max()}; give uint8"
                f" from 0 to {max_value}",
                ErrorCode.VALUE,
            )
    if np.isinf(terrain.design_difference).any():
        raise CodecError(
            "design_difference is infinite; give NaN where there is no design", ErrorCode.VALUE
        )
    for name, number in (("revision", frame.revision), ("run_id", frame.run_id)):
        if not 0 <= number < 2**32:
            raise CodecError(
                f"{name} is {number}; give a number from 0 to 2**32 - 1", ErrorCode.VALUE
            )
    if volume.min() < 0 or volume.max() >= _MAX_VOLUME_MM3:
        raise CodecError(
            f"columns hold {volume.min()} to {volume.max()} mm^3; give 0 to 2**53 - 1",
            ErrorCode.VALUE,
        )


def _write_cells(terrain: TerrainMap, cells: Rows) -> None:
    """Write a terrain into points, shape (rows, cols)."""
    frame, volume = terrain.keyframe, terrain.volume_mm3
    grid = frame.grid
    x, y = cell_positions(grid)
    # In bands that stay in the cache: each field is written to all cells of a band in turn.
    band_rows = max(1, _BAND_BYTES // (grid.cols * TERRAIN_CELL.itemsize))
    for first in range(0, grid.rows, band_rows):
        rows = slice(first, first + band_rows)
        band = cells[rows]
        band["x"], band["y"] = x[rows], y
        band["z"] = frame.elevation[rows]
        band["loose_depth"] = terrain.loose_depth[rows]
        band["surface_material"] = terrain.surface_material[rows]
        band["moisture"] = terrain.moisture[rows]
        band["soil"] = terrain.soil[rows]
        band["design_difference"] = terrain.design_difference[rows]
        band["volume_mm3"] = volume[rows]
        band["rut_depth"] = terrain.rut_depth[rows]
        band["revision"] = frame.revision
        band["run_id"] = frame.run_id


def from_terrain_cloud(msg: PointCloud2, *, cell: float | None = None) -> TerrainMap:
    """Decode a terrain.

    Args:
        msg: the message.
        cell: side length of a column [m] if known. The message has float32 positions only. Without
            `cell`, it is the number with the fewest digits that reproduces them, which is the
            configured one unless that has more than 6 digits.

    Raises:
        CodecError: GRID: not the points of a grid around the origin; VALUE; or as
            `from_point_cloud`.
    """
    return terrain_of_cells(cells_of_terrain_cloud(msg), cell=cell)


def terrain_of_cells(cells: Rows, *, cell: float | None = None) -> TerrainMap:
    """Decode a terrain from the points of its cloud.

    Args:
        cells: TERRAIN_CELL points, shape (rows, cols).
        cell: as of `from_terrain_cloud`.

    Raises:
        CodecError: GRID or VALUE, as `from_terrain_cloud`.
    """
    keyframe = keyframe_of_cells(cells, cell=cell)
    loose = cells["loose_depth"].astype(np.float64)
    # NaN fails every comparison.
    _check("loose_depth", (loose >= 0.0) & (loose < np.inf))
    difference = cells["design_difference"].copy()
    _check("design_difference", ~np.isinf(difference))
    return TerrainMap(keyframe, loose, _integer_layer(cells, "surface_material"), difference)


def cells_of_terrain_cloud(msg: PointCloud2) -> Rows:
    """Return the points of a message, shape (rows, cols).

    Raises:
        CodecError: GRID: fewer than 2 x 2 points; or as `from_point_cloud`.
    """
    cells = from_point_cloud(msg, TERRAIN_CELL)
    if msg.height < 2 or msg.width < 2:
        raise CodecError(
            f"a terrain has at least 2 x 2 columns, not {msg.height} x {msg.width}", ErrorCode.GRID
        )
    return cells.reshape(msg.height, msg.width)


def keyframe_of_cells(cells: Rows, *, cell: float | None = None) -> Keyframe:
    """Decode only the keyframe of a terrain; the other fields are not checked.

    Args:
        cells, cell: as of `terrain_of_cells`.

    Raises:
        CodecError: as `terrain_of_cells`.
    """
    grid = grid_of_cells(cells, cell)
    run_id, revision = (_constant(cells, name) for name in ("run_id", "revision"))
    elevation = cells["z"].astype(np.float64)
    _check("elevation", np.isfinite(elevation))
    volume = cells["volume_mm3"].astype(np.float64)
    is_integer = volume == np.rint(volume)
    _check("volume", (volume >= 0.0) & (volume < _MAX_VOLUME_MM3) & is_integer)
    soil, moisture = _integer_layer(cells, "soil"), _integer_layer(cells, "moisture")
    rut_depth = cells["rut_depth"].astype(np.float32)
    _check("rut_depth", (rut_depth >= 0.0) & (rut_depth < np.inf))
    layers = volume.astype(np.int64), soil, moisture, rut_depth
    return Keyframe(run_id, revision, grid, elevation, *layers)


def _integer_layer(cells: Rows, name: str) -> NDArray[np.uint8]:
    """Return a layer of integers.

    Raises:
        CodecError: VALUE.
    """
    values = cells[name].copy()
    is_valid = (values >= 0.0) & (values <= _MAX_VALUES[name]) & (values == np.rint(values))
    _check(name, is_valid)
    return values.astype(np.uint8)


def _check(name: str, is_valid: NDArray[np.bool_]) -> None:
    """Check that a layer is valid in all columns.

    Raises:
        CodecError: VALUE.
    """
    if not is_valid.all():
        row, col = np.argwhere(~is_valid)[0]
        count = int((~is_valid).sum())
        raise CodecError(
            f"{name} is invalid in {count} columns, the first of them ({row}, {col})",
            ErrorCode.VALUE,
        )


def _constant(cells: Rows, name: str) -> int:
    """Return the value of a field that is the same in every point.

    Raises:
        CodecError: VALUE: it is not.
    """
    if (cells[name] != cells[name][0, 0]).any():
        raise CodecError(f"the cloud's {name} is not the same in every point", ErrorCode.VALUE)
    return int(cells[name][0, 0])
