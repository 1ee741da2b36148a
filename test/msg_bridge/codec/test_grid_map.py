"""The terrain as GridMap, with a substitute for the package grid_map_msgs."""

import sys
import types
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from msg_bridge.bag.bundled_types import GRID_MAP_TYPE
from msg_bridge.bag.message_schemas import schema_text
from msg_bridge.codec.cdr_primitives import STAMP
from msg_bridge.codec.grid_map import grid_map_to_cdr, grid_map_type, to_grid_map
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe

GRID = Grid(3, 4, 0.5)
HEIGHTS = np.arange(12.0).reshape(GRID.shape)
NUMBERS = np.arange(12, dtype=np.uint8).reshape(GRID.shape)
TERRAIN = TerrainMap(
    Keyframe(
        *(1, 2, GRID, HEIGHTS, np.ones(GRID.shape, np.int64)),
        *(NUMBERS, 9 * NUMBERS, (0.01 * NUMBERS).astype(np.float32)),
    ),
    0.1 * HEIGHTS,
    NUMBERS % 3,
)
LAYERS = {
    "elevation": HEIGHTS,
    "loose_depth": 0.1 * HEIGHTS,
    "surface_material": NUMBERS % 3,
    "moisture": 9 * NUMBERS,
    "soil": NUMBERS,
    "design_difference": np.full(GRID.shape, np.nan),
    "rut_depth": (0.01 * NUMBERS).astype(np.float32),
}


@dataclass
class GridMap:
    """The fields of grid_map_msgs/GridMap that are set."""

    header: Any = None
    info: Any = field(default_factory=types.SimpleNamespace)
    layers: Any = None
    basic_layers: Any = None
    data: Any = None
    outer_start_index: int = 0
    inner_start_index: int = 0


@pytest.fixture
def installed(monkeypatch):
    package, module = types.ModuleType("grid_map_msgs"), types.ModuleType("grid_map_msgs.msg")
    module.GridMap = GridMap  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "grid_map_msgs", package)
    monkeypatch.setitem(sys.modules, "grid_map_msgs.msg", module)
    grid_map_type.cache_clear()
    yield
    grid_map_type.cache_clear()


def test_missing_package_gives_no_message(monkeypatch):
    monkeypatch.setitem(sys.modules, "grid_map_msgs", None)
    grid_map_type.cache_clear()
    assert to_grid_map(TERRAIN, "map", Time()) is None
    grid_map_type.cache_clear()


def test_layers_are_column_major_matrices_of_the_same_order(installed):
    message = to_grid_map(TERRAIN, "map", Time(sec=3))
    assert message.layers == list(LAYERS)
    assert (message.info.length_x, message.info.length_y) == GRID.size
    assert message.info.resolution == GRID.cell
    for layer, values in zip(message.data, LAYERS.values(), strict=True):
        columns, rows = layer.layout.dim
        assert (columns.label, columns.size, columns.stride) == ("column_index", 4, 12)
        assert (rows.label, rows.size, rows.stride) == ("row_index", 3, 3)
        back = np.array(layer.data, dtype=np.float32).reshape(4, 3).T
        assert np.array_equal(back, values.astype(np.float32), equal_nan=True)


@pytest.mark.parametrize("frame", ["map", "a", "site/map"])  # strings of various paddings
def test_serialised_grid_map_has_the_fields_of_the_message(installed, frame):
    store = get_typestore(Stores.ROS2_JAZZY)
    types_in_schema = get_types_from_msg(schema_text(GRID_MAP_TYPE), GRID_MAP_TYPE)
    store.register({k: v for k, v in types_in_schema.items() if k not in store.types})
    expected = to_grid_map(TERRAIN, frame, Time(sec=3, nanosec=4))
    found = store.deserialize_cdr(grid_map_to_cdr(TERRAIN, frame, STAMP.pack(3, 4)), GRID_MAP_TYPE)
    stamp = found.header.stamp
    assert (found.header.frame_id, stamp.sec, stamp.nanosec) == (frame, 3, 4)
    assert found.info.resolution == expected.info.resolution
    assert (found.info.length_x, found.info.length_y) == GRID.size
    assert found.info.pose.orientation.w == 1.0
    assert (found.layers, found.basic_layers) == (expected.layers, expected.basic_layers)
    for layer, other in zip(found.data, expected.data, strict=True):
        dims = [(dim.label, dim.size, dim.stride) for dim in layer.layout.dim]
        assert dims == [(dim.label, dim.size, dim.stride) for dim in other.layout.dim]
        assert np.array_equal(layer.data, np.array(other.data), equal_nan=True)
    assert (found.outer_start_index, found.inner_start_index) == (0, 0)
