"""The terrain as grid_map_msgs/GridMap: a message if that package is installed, or its bytes."""

from __future__ import annotations

import importlib
import struct
from functools import cache
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from numpy.typing import NDArray
from std_msgs.msg import Float32MultiArray, Header, MultiArrayDimension, MultiArrayLayout

from msg_bridge.codec.cdr_primitives import LITTLE_ENDIAN, UINT32, pack_string
from msg_bridge.codec.point_cloud import to_byte_array
from msg_bridge.codec.terrain import TerrainMap

__all__ = ["grid_map_to_cdr", "grid_map_type", "to_grid_map"]

_INFO = struct.Struct("<10d")
"""Resolution, length along x and y [m]; position [m] and quaternion of the centre."""

_START_INDICES = struct.pack("<HH", 0, 0)


@cache
def grid_map_type() -> Any:
    """Return the message class; None if grid_map_msgs is not installed."""
    try:
        return importlib.import_module("grid_map_msgs.msg").GridMap
    except ImportError:
        return None


def to_grid_map(terrain: TerrainMap, frame_id: str, stamp: Time) -> Any:
    """Encode a terrain with the layers of the cloud; return None without grid_map_msgs.

    The layers are `elevation`, `loose_depth`, `surface_material`, `moisture`, `soil`,
    `design_difference` and `rut_depth`; see `msg_bridge.codec.terrain`. The arrays are in the order
    of grid_map already: index (0, 0) at the +x, +y corner.
    """
    kind = grid_map_type()
    if kind is None:
        return None
    grid, layers = terrain.keyframe.grid, _layers(terrain)
    message = kind()
    message.header = Header(stamp=stamp, frame_id=frame_id)
    message.info.resolution = grid.cell
    message.info.length_x, message.info.length_y = grid.size
    message.info.pose = Pose(
        position=Point(x=0.0, y=0.0, z=0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    )
    message.layers = list(layers)
    message.basic_layers = ["elevation"]
    message.data = [_matrix(layer) for layer in layers.values()]
    return message


def grid_map_to_cdr(terrain: TerrainMap, frame_id: str, stamp: bytes) -> bytes:
    """Serialise the GridMap of `to_grid_map` without grid_map_msgs.

    Args:
        terrain: the terrain.
        frame_id: name of the map frame.
        stamp: the 8 bytes of a serialised stamp.

    Returns:
        CDR bytes, little-endian.
    """
    grid, layers = terrain.keyframe.grid, _layers(terrain)
    content = bytearray(stamp + pack_string(frame_id))
    content += b"\0" * (-len(content) % 8)
    content += _INFO.pack(grid.cell, *grid.size, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    for names in (tuple(layers), ("elevation",)):
        content += UINT32.pack(len(names))
        for name in names:
            content += pack_string(name)
    content += UINT32.pack(len(layers))
    rows, cols = grid.shape
    for layer in layers.values():
        content += UINT32.pack(2)
        for label, size, stride in (("column_index", cols, rows * cols), ("row_index", rows, rows)):
            content += pack_string(label) + UINT32.pack(size) + UINT32.pack(stride)
        content += UINT32.pack(0) + UINT32.pack(layer.size)
        content += np.ascontiguousarray(layer.T, dtype="<f4").tobytes()
    return LITTLE_ENDIAN + bytes(content) + _START_INDICES


def _layers(terrain: TerrainMap) -> dict[str, NDArray[Any]]:
    """Return the layers by name, each of shape (rows, cols)."""
    return {
        "elevation": terrain.keyframe.elevation,
        "loose_depth": terrain.loose_depth,
        "surface_material": terrain.surface_material,
        "moisture": terrain.moisture,
        "soil": terrain.soil,
        "design_difference": terrain.design_difference,
        "rut_depth": terrain.rut_depth,
    }


def _matrix(layer: NDArray[Any]) -> Float32MultiArray:
    """Return a layer as a column-major matrix of grid_map."""
    rows, cols = layer.shape
    dims = [
        MultiArrayDimension(label="column_index", size=cols, stride=rows * cols),
        MultiArrayDimension(label="row_index", size=rows, stride=rows),
    ]
    data = np.ascontiguousarray(layer.T, dtype="<f4")
    message = Float32MultiArray(layout=MultiArrayLayout(dim=dims, data_offset=0))
    message.data.frombytes(to_byte_array(data).tobytes())
    return message
