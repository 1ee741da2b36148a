"""Images of the terrain are in matrix order; map info is as for an OccupancyGrid."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time

from msg_bridge.codec.terrain_images import to_elevation_image, to_map_info
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe

STAMP = Time(sec=2)


def test_image_has_the_matrix_order_of_the_elevation() -> None:
    grid = Grid(3, 5, 0.2)
    frame = Keyframe(1, 0, grid, 0.25 * np.arange(15.0).reshape(grid.shape))
    msg = to_elevation_image(frame, "map", STAMP)
    assert (msg.height, msg.width, msg.encoding, msg.step) == (3, 5, "32FC1", 20)
    assert np.array_equal(np.frombuffer(msg.data, "<f4").reshape(3, 5), frame.elevation)


def test_info_gives_the_corner_at_minus_x_minus_y_of_the_outer_cell() -> None:
    grid = Grid(3, 5, 0.2)
    info = to_map_info(grid, STAMP)
    assert info.origin.position.x == pytest.approx(grid.x(2) - 0.1)
    assert info.origin.position.y == pytest.approx(grid.y(4) - 0.1)
    assert info.origin.orientation.w == 1.0


def test_info_counts_width_along_x_and_height_along_y() -> None:
    info = to_map_info(Grid(3, 5, 0.2), STAMP)
    assert (info.width, info.height) == (3, 5)
    assert info.resolution == pytest.approx(0.2)
