"""Definitions and hashes of message types that are written although their packages are missing.

The packages tf2_msgs and grid_map_msgs are not on PyPI. The texts are those of their branches for
Jazzy; a test computes the hashes from them.
"""

from __future__ import annotations

from typing import Final, NamedTuple

__all__ = ["BUNDLED_TYPES", "GRID_MAP_TYPE", "TF_TYPE", "BundledType"]

TF_TYPE: Final = "tf2_msgs/msg/TFMessage"
GRID_MAP_TYPE: Final = "grid_map_msgs/msg/GridMap"


class BundledType(NamedTuple):
    """A message type.

    Attributes:
        definition: text of its .msg file.
        type_hash: `RIHS01_` and 64 hexadecimal digits.
    """

    definition: str
    type_hash: str


_GRID_MAP = """\
# Header (time and frame)
std_msgs/Header header

# Grid map header
GridMapInfo info

# Grid map layer names.
string[] layers

# Grid map basic layer names (optional). The basic layers
# determine which layers from `layers` need to be valid
# in order for a cell of the grid map to be valid.
string[] basic_layers

# Grid map data.
std_msgs/Float32MultiArray[] data

# Row start index (default 0).
uint16 outer_start_index

# Column start index (default 0).
uint16 inner_start_index
"""

_GRID_MAP_INFO = """\
# Resolution of the grid [m/cell].
float64 resolution

# Length in x-direction [m].
float64 length_x

# Length in y-direction [m].
float64 length_y

# Pose of the grid map center in the frame defined in `header` [m].
geometry_msgs/Pose pose
"""

BUNDLED_TYPES: Final = {
    TF_TYPE: BundledType(
        "geometry_msgs/TransformStamped[] transforms\n",
        "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    ),
    GRID_MAP_TYPE: BundledType(
        _GRID_MAP, "RIHS01_343b0e72887541beda6b035cc053f2d6fffaad9d6dcb2773c15a808dfca31fde"
    ),
    "grid_map_msgs/msg/GridMapInfo": BundledType(
        _GRID_MAP_INFO, "RIHS01_0a36d6b5bc9af8463d1d5a5008ef9fcac0c1373ba090f80c3594e47cc565b745"
    ),
}
"""Types by name. An installed definition takes precedence."""
