"""Conversion between north-up images and the matrix order of the grid.

In an image row 0 is north and column 0 west. In the map frame x is east and y north (REP 103),
and the matrix starts at +x, +y: row 0 is east and column 0 north. The matrix is therefore the image
rotated by 90 degrees counter-clockwise::

    image     NW  N  NE        matrix   NE  E  SE      row 0: +x
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
    image: ArrayLike, cell: float, georeference: Georeference | None = None
) -> HeightMap:
    """Return the map of an image of heights [m], shape (north to south, west to east).

    Args:
        image: heights [m], row 0 north, column 0 west.
        cell: spacing [m].
        georeference: georeference of the centre of the image.

    Raises:
        TerrainError: a height is invalid, see `HeightMap`.
        ParameterError: the spacing is out of range.
    """
    heights = matrix_from_north_up(as_height_array(image))
    return HeightMap(Grid(heights.shape[0], heights.shape[1], cell), heights, georeference)


def to_north_up(matrix: NDArray[_Value]) -> NDArray[_Value]:
    """Return a matrix, shape (rows, cols), as an image, shape (cols, rows)."""
    return np.rot90(matrix, -1)


def matrix_from_north_up(image: NDArray[_Value]) -> NDArray[_Value]:
    """Return an image, shape (height, width), in matrix order, shape (width, height)."""
    return np.rot90(image)
