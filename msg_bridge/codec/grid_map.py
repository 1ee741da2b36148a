"""The terrain as grid_map_msgs/GridMap, if that package is installed."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from numpy.typing import NDArray
from std_msgs.msg import Float32MultiArray, Header, MultiArrayDimension, MultiArrayLayout

from msg_bridge.codec.point_cloud import to_byte_array
from msg_bridge.codec.terrain import TerrainMap

__all__ = ["grid_map_type", "to_grid_map"]


@cache
def grid_map_type() -> Any:
    """Return the message class; None if grid_map_msgs is not installed."""
    try:
        return importlib.import_module("grid_map_msgs.msg").GridMap
    except ImportError:
        return None


def to_grid_map(terrain: TerrainMap, frame_id: str, stamp: Time) -> Any:
    """Encode a terrain with the layers of the cloud; return None without grid_map_msgs.

    The layers are `elevation`, `loose_depth`, `surface_material`, `moisture`, `soil` and
    `design_difference`; see `msg_bridge.codec.terrain`. The arrays are in the order of
    grid_map already: index (0, 0) at the +x, +y corner.
    """
    kind = grid_map_type()
    if kind is None:
        return None
    grid = terrain.keyframe.grid
    layers: dict[str, NDArray[Any]] = {
        "elevation": terrain.keyframe.elevation,
        "loose_depth": terrain.loose_depth,
        "surface_material": terrain.surface_material,
        "moisture": terrain.moisture,
        "soil": terrain.soil,
        "design_difference": terrain.design_difference,
    }
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
