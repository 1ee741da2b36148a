"""The grid of soil columns and its coordinates in the map frame.

A grid point is the centre of an l x l column, so a map of n x n columns is n*l wide. Matrix order
and axes are those of grid_map: index (0, 0) is at the +x, +y corner, row indices grow toward -x and
column indices toward -y. The origin of the map frame is the centre of the map::

              +x
        (0,0) ^ (0,cols-1)
          +---|---+
          |   |   |
    +y <------o   |          row i:  x = x_first - i*cell
          |       |          col j:  y = y_first - j*cell
          +-------+
    (rows-1,0)  (rows-1,cols-1)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.contract.errors import ParameterError

__all__ = ["Grid"]


@dataclass(frozen=True)
class Grid:
    """Number of rows and columns, and spacing, of a terrain centred at the origin.

    Attributes:
        rows: number of columns of soil along x, at least 2.
        cols: number of columns of soil along y, at least 2.
        cell: side length l of a column [m], 0.01 to 1000.
    """

    rows: int
    cols: int
    cell: float

    def __post_init__(self) -> None:
        if self.rows < 2 or self.cols < 2:
            raise ParameterError(
                f"a grid needs at least 2 x 2 columns, not {self.rows} x {self.cols}"
            )
        if not (np.isfinite(self.cell) and 0.01 <= self.cell <= 1e3):
            raise ParameterError(
                f"cell is {self.cell!r} m; give a spacing between 0.01 m and 1000 m"
            )
        # Kernels of one signature would misread an integer.
        object.__setattr__(self, "cell", float(self.cell))

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return (self.rows, self.cols)

    @property
    def size(self) -> tuple[float, float]:
        """Extent of the map along x and y [m]: rows*cell, cols*cell."""
        return (self.rows * self.cell, self.cols * self.cell)

    @property
    def x_first(self) -> float:
        """x of row 0, the largest [m]."""
        return 0.5 * (self.rows - 1) * self.cell

    @property
    def y_first(self) -> float:
        """y of column 0, the largest [m]."""
        return 0.5 * (self.cols - 1) * self.cell

    @property
    def cell_area_mm2(self) -> float:
        """Area of one column [mm^2]."""
        return (self.cell * 1e3) ** 2

    def x(self, row: ArrayLike) -> NDArray[np.float64]:
        """Return x of a (fractional) row index [m], map frame."""
        return self.x_first - np.asarray(row, dtype=np.float64) * self.cell

    def y(self, col: ArrayLike) -> NDArray[np.float64]:
        """Return y of a (fractional) column index [m], map frame."""
        return self.y_first - np.asarray(col, dtype=np.float64) * self.cell

    def row(self, x: ArrayLike) -> NDArray[np.float64]:
        """Return the fractional row index of x [m], map frame; not clipped to the map."""
        return (self.x_first - np.asarray(x, dtype=np.float64)) / self.cell

    def col(self, y: ArrayLike) -> NDArray[np.float64]:
        """Return the fractional column index of y [m], map frame; not clipped to the map."""
        return (self.y_first - np.asarray(y, dtype=np.float64)) / self.cell

    def contains(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Return whether points [m], map frame, lie on the map, its edge included."""
        half_x, half_y = 0.5 * self.size[0], 0.5 * self.size[1]
        is_inside = (np.abs(np.asarray(x)) <= half_x) & (np.abs(np.asarray(y)) <= half_y)
        return np.asarray(is_inside, dtype=np.bool_)
