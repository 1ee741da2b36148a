"""Window: the part of the map that a picture shows, x to the right and y up.

A matrix has row 0 at +x and column 0 at +y (see `Grid`); an image has row 0 at the lowest y and
column 0 at the lowest x. Only `to_image` converts one into the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid

__all__ = ["Window", "to_image", "window_around"]

MIN_WINDOW_SIZE_M = 12.0  # minimum side of a window [m]
MARGIN_M = 1.5  # margin around the points of a window [m]
MIN_ASPECT_RATIO = 0.6  # minimum ratio of a window's sides


def to_image(grid: Grid, array: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return a matrix (rows, cols) as an image (cols, rows) with x to the right and y up.

    Row 0 of the image is the lowest y: draw it with `origin="lower"`. It is a view of the matrix.

    Raises:
        ParameterError: the matrix is not of the grid's shape.
    """
    if array.shape != grid.shape:
        raise ParameterError(f"array has shape {array.shape}; the grid's is {grid.shape}")
    return array[::-1, ::-1].T


@dataclass(frozen=True)
class Window:
    """A rectangle of columns of soil: image columns left to right - 1, rows bottom to top - 1."""

    grid: Grid
    left: int
    right: int
    bottom: int
    top: int

    @classmethod
    def whole(cls, grid: Grid) -> Window:
        """Return the window of the whole map."""
        return cls(grid, 0, grid.rows, 0, grid.cols)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max of the outer edges [m], map frame."""
        half_x, half_y = 0.5 * self.grid.size[0], 0.5 * self.grid.size[1]
        cell = self.grid.cell
        return (
            self.left * cell - half_x,
            self.right * cell - half_x,
            self.bottom * cell - half_y,
            self.top * cell - half_y,
        )

    @property
    def size(self) -> tuple[float, float]:
        """Extent along x and y [m]."""
        return (
            (self.right - self.left) * self.grid.cell,
            (self.top - self.bottom) * self.grid.cell,
        )

    @property
    def x(self) -> NDArray[np.float64]:
        """x of the columns of soil, ascending [m], shape (right - left,)."""
        return (
            np.arange(self.left, self.right, dtype=np.float64) * self.grid.cell - self.grid.x_first
        )

    @property
    def y(self) -> NDArray[np.float64]:
        """y of the columns of soil, ascending [m], shape (top - bottom,)."""
        return (
            np.arange(self.bottom, self.top, dtype=np.float64) * self.grid.cell - self.grid.y_first
        )

    def crop(self, array: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a matrix as an image of the window, shape (top - bottom, right - left)."""
        image = to_image(self.grid, array)[self.bottom : self.top, self.left : self.right]
        return image.astype(np.float64)


def window_around(grid: Grid, points: NDArray[np.float64]) -> Window:
    """Return the window around points x, y [m], shape (n, 2), with a margin; at least 12 m square.

    Near the border it is moved inward; a map smaller than that is shown whole.
    """
    if not len(points):
        points = np.zeros((1, 2))
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    side = np.maximum(high - low, MIN_WINDOW_SIZE_M)
    side = np.maximum(side, MIN_ASPECT_RATIO * side.max())
    middle = 0.5 * (low + high)
    cells = np.minimum(np.ceil(side / grid.cell).astype(int), grid.shape)
    first = np.round((middle + 0.5 * np.array(grid.size)) / grid.cell - 0.5 * cells).astype(int)
    first = np.clip(first, 0, np.array(grid.shape) - cells)
    left, bottom = first.tolist()
    right, top = (first + cells).tolist()
    return Window(grid, left, right, bottom, top)
