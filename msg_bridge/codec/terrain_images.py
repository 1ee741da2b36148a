"""The terrain surface as images, and map info.

Images are in the matrix order of grid_map, as the arrays are: height = rows, width = cols, pixel
(0, 0) at the +x, +y corner, rows toward -x and columns toward -y. Map info is as for an
OccupancyGrid instead: width counts cells along x, height cells along y, and the origin is the -x,
-y corner of the outer cell, at the opposite end of the matrix.
"""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData
from numpy.typing import NDArray
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from msg_bridge.codec.point_cloud import to_byte_array
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe

__all__ = ["to_elevation_image", "to_map_info", "to_tilt_image"]


def to_elevation_image(keyframe: Keyframe, frame_id: str, stamp: Time) -> Image:
    """Encode the elevation as a 32FC1 image [m]."""
    return _float_image(keyframe.elevation, "32FC1", frame_id, stamp)


def to_tilt_image(tilt: NDArray[np.float32], frame_id: str, stamp: Time) -> Image:
    """Encode the tilt of the surface of loose soil as a 32FC2 image: slopes along x and y [-].

    Args:
        tilt: shape (rows, cols, 2), float32.
        frame_id: the map frame.
        stamp: time from which it is valid.
    """
    return _float_image(tilt, "32FC2", frame_id, stamp)


def to_map_info(grid: Grid, stamp: Time) -> MapMetaData:
    """Encode position and size of the map; `width` counts cells along x, `height` along y."""
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


def _float_image(values: NDArray[np.floating], encoding: str, frame_id: str, stamp: Time) -> Image:
    """Return an image of float32 with one or more channels."""
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
