"""Images of terrain are north-up; the matrix starts at +x (east), +y (north)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from msg_bridge.contract.grid import Grid
from soil_sim.terrain import from_north_up, to_north_up


@pytest.mark.parametrize(
    ("corner", "east", "north"),
    [((0, -1), 1, 1), ((0, 0), -1, 1), ((-1, -1), 1, -1), ((-1, 0), -1, -1)],
    ids=["NE", "NW", "SE", "SW"],
)
def test_corner_of_an_image_is_the_same_corner_of_the_map(corner, east, north):
    picture = np.zeros((3, 6))
    picture[corner] = 1.0
    made = from_north_up(picture, 0.5)
    row, col = np.argwhere(made.heights == 1.0)[0]
    assert made.grid == Grid(6, 3, 0.5)
    assert (made.grid.x(row), made.grid.y(col)) == (east * 1.25, north * 0.5)


@given(height=st.integers(2, 9), width=st.integers(2, 9))
def test_every_pixel_has_its_easting_and_northing(height, width):
    picture = np.arange(height * width).reshape(height, width)
    made = from_north_up(picture, 2.0)
    x, y = made.grid.x(np.arange(width)), made.grid.y(np.arange(height))
    column = np.rint((x + (width - 1.0)) / 2.0).astype(int)  # from the west edge
    row = np.rint(((height - 1.0) - y) / 2.0).astype(int)  # from the north edge
    assert np.array_equal(made.heights, picture[row[None, :], column[:, None]])


def test_image_round_trips():
    picture = np.arange(12.0).reshape(3, 4)
    assert np.array_equal(to_north_up(from_north_up(picture, 1.0).heights), picture)
