"""Views of a terrain: which columns they show, and their message."""

from __future__ import annotations

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.point_cloud import from_point_cloud
from msg_bridge.codec.terrain_view import MAX_VIEW_SIZE, TERRAIN_VIEW, view_slices, view_to_cdr
from msg_bridge.contract.grid import Grid

GRID = Grid(41, 21, 0.5)
"""x from 10 to -10 m, y from 5 to -5 m."""


@pytest.mark.parametrize(
    ("region", "decimation", "rows", "cols"),
    [
        ((), 0, slice(0, 41, 1), slice(0, 21, 1)),
        ((), 4, slice(0, 41, 4), slice(0, 21, 4)),
        ((2.0, -1.0, -3.0, 4.0), 0, slice(16, 27, 1), slice(2, 13, 1)),
        ((2.1, -99.0, 99.0, 99.0), 2, slice(0, 17, 2), slice(0, 21, 2)),
        ((50.0, 50.0, 60.0, 60.0), 1, slice(0, 1, 1), slice(0, 1, 1)),
    ],
)
def test_view_shows_a_region(
    region: tuple[float, ...], decimation: int, rows: slice, cols: slice
) -> None:
    assert view_slices(GRID, region, decimation) == (rows, cols)


@pytest.mark.parametrize("size", [2, 257, 258, 2049, 4097])
def test_view_of_any_terrain_is_small_by_default(size: int) -> None:
    rows, cols = view_slices(Grid(size, 2, 0.2), (), 0)
    shown = len(range(*rows.indices(size)))
    assert MAX_VIEW_SIZE // 2 < shown <= MAX_VIEW_SIZE or shown == size
    assert cols == slice(0, 2, rows.step)


def test_view_has_positions_and_layers() -> None:
    rows, cols = view_slices(GRID, (), 10)
    height = np.arange(GRID.rows * GRID.cols, dtype=np.float64).reshape(GRID.shape)[rows, cols]
    data = view_to_cdr(GRID, rows, cols, {"z": height}, "map", Time(sec=2))
    msg = deserialize_message(data, PointCloud2)
    assert (msg.height, msg.width, msg.header.frame_id) == (5, 3, "map")
    points = from_point_cloud(msg, TERRAIN_VIEW).reshape(5, 3)
    assert points["x"][:, 0].tolist() == [10.0, 5.0, 0.0, -5.0, -10.0]
    assert points["y"][0].tolist() == [5.0, 0.0, -5.0]
    assert (points["z"] == height).all()
    assert not points["moisture"].any()
