"""The whole terrain surface as messages: organised cloud, image, map info.

Cloud and image are in matrix order of grid_map, as the arrays are: height = rows, width = cols,
point (0, 0) at the +x, +y corner, rows toward -x and columns toward -y. Map info is as for an
OccupancyGrid instead: width counts cells along x, height cells along y, and the origin is the
-x, -y corner of the outer cell, at the opposite end of the matrix.

A cloud has no place for a number of its own, so `revision` and `epoch` are fields like the others
and the same in every point. Beside the changed cells' `revision` field they tell which changes a
keyframe already holds, in one message, whatever order two topics arrive in. z is the elevation;
there is no second field for it. What else a surface is like is float32, as viewers colour by it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import from_point_cloud, to_byte_array, to_point_cloud
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import Rows

__all__ = [
    "TERRAIN_CELL",
    "TerrainMap",
    "from_terrain_cloud",
    "keyframe_from_terrain_cloud",
    "to_elevation_image",
    "to_map_info",
    "to_terrain_cloud",
    "to_tilt_image",
]

TERRAIN_CELL = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),  # elevation
        ("loose_depth", "<f4"),
        ("surface_material", "<f4"),  # 0 untouched, 1 dug, 2 dirt
        ("moisture", "<f4"),  # [% of saturation], 0 to 100
        ("soil", "<f4"),  # id of the kind at the surface, see the kinds in /sim/config
        ("design_difference", "<f4"),  # elevation minus design [m], NaN where there is none
        ("volume_mm3", "<f8"),  # exact: whole numbers below 2**53
        ("revision", "<u4"),  # the same in every cell
        ("run_id", "<u4"),  # likewise
    ]
)
"""A point of the terrain cloud; fields of the same name are those of a CHANGED row, which holds
soil and moisture as whole numbers."""

_MAX_VOLUME_MM3 = 2**53

_MAX_VALUES = {"surface_material": 2, "moisture": 100, "soil": 255}
"""Largest value of each layer of whole numbers."""


@dataclass(frozen=True)
class TerrainMap:
    """A keyframe with what a stranger wants to know besides. Arrays have shape (rows, cols).

    Attributes:
        keyframe: the surface and what it is of; heights to float32 precision once it has crossed.
        loose_depth: depth of loose soil [m]; likewise.
        surface_material: what the surface looks like, uint8: 0 untouched, 1 dug, 2 dirt.
        design_difference: elevation minus design [m], float32, NaN where nothing is designed.

    Materials that are not given are zeros, the difference from a design NaN.
    """

    keyframe: Keyframe
    loose_depth: NDArray[np.float64]
    surface_material: NDArray[np.uint8] = None  # type: ignore[assignment]
    design_difference: NDArray[np.float32] = None  # type: ignore[assignment]

    @property
    def volume_mm3(self) -> NDArray[np.int64]:
        """Bank volume above the floor; exact."""
        return self.keyframe.volume_mm3

    @property
    def soil(self) -> NDArray[np.uint8]:
        """Id of the soil at the surface."""
        return self.keyframe.soil

    @property
    def moisture(self) -> NDArray[np.uint8]:
        """Of the soil at the surface [% of saturation]."""
        return self.keyframe.moisture

    def __post_init__(self) -> None:
        """Fill in the layers that are not given."""
        shape = self.keyframe.grid.shape
        if self.surface_material is None:
            object.__setattr__(self, "surface_material", np.zeros(shape, dtype=np.uint8))
        if self.design_difference is None:
            nothing = np.full(shape, np.nan, dtype=np.float32)
            object.__setattr__(self, "design_difference", nothing)


def to_terrain_cloud(terrain: TerrainMap, frame_id: str, stamp: Time) -> PointCloud2:
    """A terrain as an organised cloud of TERRAIN_CELL points.

    Raises:
        CodecError: an array of another shape, a number that does not fit its field, or one that
            no surface has.
    """
    frame = terrain.keyframe
    grid, volume = frame.grid, terrain.volume_mm3
    for name, layer in (
        ("elevation", frame.elevation),
        ("loose_depth", terrain.loose_depth),
        ("volume_mm3", volume),
        ("design_difference", terrain.design_difference),
        *((name, getattr(terrain, name)) for name in _MAX_VALUES),
    ):
        if layer.shape != grid.shape:
            raise CodecError(f"{name} has shape {layer.shape} on a grid of {grid.shape}")
    for name, most in _MAX_VALUES.items():
        layer = getattr(terrain, name)
        if layer.dtype != np.uint8 or layer.max() > most:
            raise CodecError(
                f"{name} is of type {layer.dtype} and goes to {layer.max()}; give uint8 from 0 to"
                f" {most}"
            )
    if np.isinf(terrain.design_difference).any():
        raise CodecError("design_difference is infinite; give NaN where nothing is designed")
    for name, number in (("revision", frame.revision), ("run_id", frame.run_id)):
        if not 0 <= number < 2**32:
            raise CodecError(f"{name} {number} does not fit 32 bits; number them from 0")
    if volume.min() < 0 or volume.max() >= _MAX_VOLUME_MM3:
        raise CodecError(
            f"columns hold {volume.min()} to {volume.max()} mm^3; a message carries 0 to 2**53"
        )
    cells = np.empty(grid.shape, dtype=TERRAIN_CELL)
    cells["x"], cells["y"] = _positions(grid)
    cells["z"] = frame.elevation
    cells["loose_depth"] = terrain.loose_depth
    cells["surface_material"] = terrain.surface_material
    cells["moisture"] = terrain.moisture
    cells["soil"] = terrain.soil
    cells["design_difference"] = terrain.design_difference
    cells["volume_mm3"] = volume
    cells["revision"] = frame.revision
    cells["run_id"] = frame.run_id
    return to_point_cloud(cells.reshape(-1), frame_id, stamp, height=grid.rows)


def from_terrain_cloud(msg: PointCloud2, *, cell: float | None = None) -> TerrainMap:
    """The terrain of a message.

    Args:
        msg: the message.
        cell: side length of a column [m] if known. The message has float32 positions only; without
            `cell` it is the number of fewest digits that makes them, which is the one that was
            configured unless that has more than 6.

    Raises:
        CodecError: not the points of a grid around the origin, or not a terrain; says why.
    """
    cells = _cells_from_cloud(msg)
    keyframe = _keyframe_from_cells(cells, cell)
    loose = cells["loose_depth"].astype(np.float64)
    # NaN fails every comparison.
    _check("loose_depth", (loose >= 0.0) & (loose < np.inf))
    difference = cells["design_difference"].copy()
    _check("design_difference", ~np.isinf(difference))
    return TerrainMap(keyframe, loose, _whole_numbers(cells, "surface_material"), difference)


def keyframe_from_terrain_cloud(msg: PointCloud2, *, cell: float | None = None) -> Keyframe:
    """The surface and what it is of, for who needs no more; other fields are not looked at.

    Args:
        msg, cell: as for `from_terrain_cloud`.

    Raises:
        CodecError: as `from_terrain_cloud`, but for what the other fields hold.
    """
    return _keyframe_from_cells(_cells_from_cloud(msg), cell)


def to_elevation_image(keyframe: Keyframe, frame_id: str, stamp: Time) -> Image:
    """The surface as a 32FC1 image [m]."""
    return _float_image(keyframe.elevation, "32FC1", frame_id, stamp)


def to_tilt_image(tilt: NDArray[np.float32], frame_id: str, stamp: Time) -> Image:
    """How the surface of loose soil leans, as a 32FC2 image: slopes along x and y [-].

    Args:
        tilt: shape (rows, cols, 2).
        frame_id: of the map.
        stamp: since when.
    """
    return _float_image(tilt, "32FC2", frame_id, stamp)


def to_map_info(grid: Grid, stamp: Time) -> MapMetaData:
    """Where the map lies. `width` counts cells along x and `height` along y, unlike an image's."""
    length_x, length_y = grid.size
    return MapMetaData(
        map_load_time=stamp,
        resolution=grid.cell,
        width=grid.rows,
        height=grid.cols,
        origin=Pose(
            position=Point(x=-0.5 * length_x, y=-0.5 * length_y, z=0.0),
            orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        ),
    )


def _cells_from_cloud(msg: PointCloud2) -> Rows:
    """The points of a message, shape (rows, cols)."""
    cells = from_point_cloud(msg, TERRAIN_CELL)
    if msg.height < 2 or msg.width < 2:
        raise CodecError(f"a terrain has at least 2 x 2 columns, not {msg.height} x {msg.width}")
    return cells.reshape(msg.height, msg.width)


def _keyframe_from_cells(cells: Rows, cell: float | None) -> Keyframe:
    grid = _grid_of(cells, cell)
    run_id, revision = (_constant(cells, name) for name in ("run_id", "revision"))
    elevation = cells["z"].astype(np.float64)
    _check("elevation", np.isfinite(elevation))
    volume = cells["volume_mm3"].astype(np.float64)
    whole = volume == np.rint(volume)
    _check("volume", (volume >= 0.0) & (volume < _MAX_VOLUME_MM3) & whole)
    soil, moisture = _whole_numbers(cells, "soil"), _whole_numbers(cells, "moisture")
    return Keyframe(run_id, revision, grid, elevation, volume.astype(np.int64), soil, moisture)


def _whole_numbers(cells: Rows, name: str) -> NDArray[np.uint8]:
    """A layer of whole numbers."""
    values = cells[name].copy()
    proper = (values >= 0.0) & (values <= _MAX_VALUES[name]) & (values == np.rint(values))
    _check(name, proper)
    return values.astype(np.uint8)


def _check(name: str, proper: NDArray[np.bool_]) -> None:
    """Refuse a terrain with columns that are not proper."""
    if not proper.all():
        row, col = np.argwhere(~proper)[0]
        count = int((~proper).sum())
        raise CodecError(f"column {row}, {col} has no proper {name}; {count} are like it")


def _positions(grid: Grid) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """x of every row, shape (rows, 1), and y of every column, shape (1, cols) [m]."""
    x = grid.x(np.arange(grid.rows)).astype(np.float32)
    y = grid.y(np.arange(grid.cols)).astype(np.float32)
    return x[:, None], y[None, :]


def _grid_of(cells: Rows, cell: float | None) -> Grid:
    """The grid whose points these are; of those to be told apart by float32, the roundest."""
    rows, cols = cells.shape
    guess = _estimate_cell(cells["x"][:, 0], cells["y"][0])
    candidates = [float(f"{guess:.{n}g}") for n in range(1, 18)] if cell is None else [cell]
    for candidate in candidates:
        try:
            grid = Grid(rows, cols, candidate)
        except ParameterError:
            continue
        x, y = _positions(grid)
        # The corners first: most candidates fail there.
        if cells["x"][0, 0] == x[0, 0] and (cells["x"] == x).all() and (cells["y"] == y).all():
            return grid
    wanted = "one size" if cell is None else f"{cell} m"
    raise CodecError(
        f"the cloud's x and y are not those of {rows} x {cols} cells of {wanted} around the origin,"
        " from +x, +y on"
    )


def _estimate_cell(*axes: NDArray[np.float32]) -> float:
    """The middle of all side lengths [m] that float32 rounds to these positions of rows, cols."""
    position = np.concatenate(axes)
    steps = np.concatenate([0.5 * (axis.size - 1) - np.arange(axis.size) for axis in axes])
    off = steps != 0.0
    position, steps = position[off], steps[off]
    with np.errstate(invalid="ignore"):  # whatever a stranger sent: the guess is checked
        nearest = position.astype(np.float64) / steps
        spread = 0.5 * np.spacing(np.abs(position)).astype(np.float64) / np.abs(steps)
        return 0.5 * float(np.max(nearest - spread) + np.min(nearest + spread))


def _constant(cells: Rows, name: str) -> int:
    if (cells[name] != cells[name][0, 0]).any():
        raise CodecError(f"the cloud's {name} is not the same in every point")
    return int(cells[name][0, 0])


def _float_image(values: NDArray[np.floating], encoding: str, frame_id: str, stamp: Time) -> Image:
    """An image of float32, one or more channels for each cell."""
    data = np.ascontiguousarray(values, dtype="<f4")
    return Image(
        header=Header(stamp=stamp, frame_id=frame_id),
        height=data.shape[0],
        width=data.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=data.strides[0],
        data=to_byte_array(data),
    )
