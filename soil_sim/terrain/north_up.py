"""Between a north-up picture of the ground and the grid's matrix order.

In a picture row 0 is north and column 0 west. In the map frame x is east and y north (REP 103),
and the matrix starts at +x, +y: row 0 is east and column 0 north. The matrix is thus the picture
turned a quarter counter-clockwise::

    picture   NW  N  NE        matrix   NE  E  SE      row 0: +x
              W      E                  N      S
              SW  S  SE                 NW  W  SW
                                     column 0: +y
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.height_map import HeightMap, as_height_array

_Value = TypeVar("_Value", bound=np.generic)

__all__ = ["from_north_up", "matrix_from_north_up", "to_north_up"]


def from_north_up(
    picture: ArrayLike, cell: float, georeference: Georeference | None = None
) -> HeightMap:
    """The map of a picture of heights [m], shape (north to south, west to east).

    Args:
        picture: heights [m], row 0 north, column 0 west.
        cell: spacing [m].
        georeference: where the picture's centre lies.

    Raises:
        TerrainError: the heights cannot be ground, see `HeightMap`.
        ParameterError: no grid has such a spacing.
    """
    heights = matrix_from_north_up(as_height_array(picture))
    return HeightMap(Grid(heights.shape[0], heights.shape[1], cell), heights, georeference)


def to_north_up(matrix: NDArray[_Value]) -> NDArray[_Value]:
    """Matrix order, shape (rows, cols), as a picture, shape (cols, rows)."""
    return np.rot90(matrix, -1)


def matrix_from_north_up(picture: NDArray[_Value]) -> NDArray[_Value]:
    """A picture, shape (height, width), in matrix order, shape (width, height)."""
    return np.rot90(picture)
