"""The whole terrain surface as messages: organised cloud, image, map info.

Cloud and image are in matrix order of grid_map, as the arrays are: height = rows, width = cols,
point (0, 0) at the +x, +y corner, rows toward -x and columns toward -y. Map info is as for an
OccupancyGrid instead: width counts cells along x, height cells along y, and the origin is the
-x, -y corner of the outer cell, at the opposite end of the matrix.

A cloud has no place for a number of its own, so `revision` and `epoch` are fields like the others
and the same in every point. Beside the changed cells' `revision` field they tell which changes a
keyframe already holds, in one message, whatever order two topics arrive in; they fill up 24 bytes
of a point to 32. z is the elevation; there is no second field for it.
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
from msg_bridge.codec.point_cloud import bytes_of, from_point_cloud, to_point_cloud
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import Rows

__all__ = [
    "TERRAIN_CELL",
    "TerrainMap",
    "from_terrain_cloud",
    "to_elevation_image",
    "to_map_info",
    "to_terrain_cloud",
]

TERRAIN_CELL = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),  # elevation
        ("loose_depth", "<f4"),
        ("volume_mm3", "<f8"),  # exact: whole numbers below 2**53
        ("revision", "<u4"),  # the same in every cell
        ("epoch", "<u4"),  # likewise
    ]
)
"""A point of the terrain cloud; fields of the same name are those of a CHANGED row."""

_LARGEST_VOLUME = 2**53


@dataclass(frozen=True)
class TerrainMap:
    """A keyframe with what a stranger wants to know besides.

    Attributes:
        keyframe: the surface; to float32 precision once it has crossed.
        loose_depth: depth of loose soil [m], shape (rows, cols); likewise.
        volume_mm3: bank volume above the floor, shape (rows, cols), int64; exact.
    """

    keyframe: Keyframe
    loose_depth: NDArray[np.float64]
    volume_mm3: NDArray[np.int64]


def to_terrain_cloud(terrain: TerrainMap, frame_id: str, stamp: Time) -> PointCloud2:
    """A terrain as an organised cloud of TERRAIN_CELL points.

    Raises:
        CodecError: an array of another shape, or a number that does not fit its field.
    """
    frame = terrain.keyframe
    grid, volume = frame.grid, terrain.volume_mm3
    for name, layer in (
        ("elevation", frame.elevation),
        ("loose_depth", terrain.loose_depth),
        ("volume_mm3", volume),
    ):
        if layer.shape != grid.shape:
            raise CodecError(f"{name} has shape {layer.shape} on a grid of {grid.shape}")
    for name, number in (("revision", frame.revision), ("epoch", frame.epoch)):
        if not 0 <= number < 2**32:
            raise CodecError(f"{name} {number} does not fit 32 bits; number them from 0")
    if volume.min() < 0 or volume.max() >= _LARGEST_VOLUME:
        raise CodecError(
            f"columns hold {volume.min()} to {volume.max()} mm^3; a message carries 0 to 2**53"
        )
    cells = np.empty(grid.shape, dtype=TERRAIN_CELL)
    cells["x"], cells["y"] = _positions(grid)
    cells["z"] = frame.elevation
    cells["loose_depth"] = terrain.loose_depth
    cells["volume_mm3"] = volume
    cells["revision"] = frame.revision
    cells["epoch"] = frame.epoch
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
    cells = from_point_cloud(msg, TERRAIN_CELL)
    if msg.height < 2 or msg.width < 2:
        raise CodecError(f"a terrain has at least 2 x 2 columns, not {msg.height} x {msg.width}")
    cells = cells.reshape(msg.height, msg.width)
    grid = _grid_of(cells, cell)
    epoch, revision = (_constant(cells, name) for name in ("epoch", "revision"))
    volume = cells["volume_mm3"].astype(np.float64)  # beside one another: the checks are faster
    for name, bad in (
        ("elevation", ~np.isfinite(cells["z"])),
        ("loose_depth", ~(np.isfinite(cells["loose_depth"]) & (cells["loose_depth"] >= 0.0))),
        # NaN fails every comparison.
        ("volume", ~((volume >= 0.0) & (volume < _LARGEST_VOLUME) & (volume == np.rint(volume)))),
    ):
        if bad.any():
            row, col = np.argwhere(bad)[0]
            raise CodecError(f"column {row}, {col} has no proper {name}; {bad.sum()} are like it")
    return TerrainMap(
        Keyframe(epoch, revision, grid, cells["z"].astype(np.float64)),
        cells["loose_depth"].astype(np.float64),
        volume.astype(np.int64),
    )


def to_elevation_image(keyframe: Keyframe, frame_id: str, stamp: Time) -> Image:
    """The surface as a 32FC1 image [m]."""
    rows, cols = keyframe.grid.shape
    return Image(
        header=Header(stamp=stamp, frame_id=frame_id),
        height=rows,
        width=cols,
        encoding="32FC1",
        is_bigendian=0,
        step=4 * cols,
        data=bytes_of(keyframe.elevation.astype("<f4")),
    )


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


def _positions(grid: Grid) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """x of every row, shape (rows, 1), and y of every column, shape (1, cols) [m]."""
    x = grid.x(np.arange(grid.rows)).astype(np.float32)
    y = grid.y(np.arange(grid.cols)).astype(np.float32)
    return x[:, None], y[None, :]


def _grid_of(cells: Rows, cell: float | None) -> Grid:
    """The grid whose points these are; of those to be told apart by float32, the roundest."""
    rows, cols = cells.shape
    guess = _likely_cell(cells["x"][:, 0], cells["y"][0])
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


def _likely_cell(*axes: NDArray[np.float32]) -> float:
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
