"""Rectangular windows of a map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import kernel

__all__ = ["WindowBounds"]


class WindowBounds(NamedTuple):
    """Rows and columns of a window [cells].

    Attributes:
        first_row, end_row: first row, and the row after the last.
        first_col, end_col: first column, and the column after the last.
    """

    first_row: int
    end_row: int
    first_col: int
    end_col: int

    @classmethod
    def enclosing(cls, cells: NDArray[np.int64], cols: int) -> WindowBounds:
        """Return the smallest window that contains some columns.

        Args:
            cells: flat indices of the columns, at least one.
            cols: number of columns of the map.
        """
        return cls(*_enclose(cells, cols))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and of columns of the window."""
        return self.end_row - self.first_row, self.end_col - self.first_col

    @property
    def num_cells(self) -> int:
        """Number of columns in the window."""
        rows, cols = self.shape
        return rows * cols

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slices of the window in a layer of the map."""
        return slice(self.first_row, self.end_row), slice(self.first_col, self.end_col)

    def cells(self, cols: int) -> NDArray[np.int64]:
        """Return the flat indices of all columns in the window of a map with `cols` columns."""
        i, j = np.arange(self.first_row, self.end_row), np.arange(self.first_col, self.end_col)
        return (i[:, None] * cols + j).reshape(-1)

    def union(self, other: WindowBounds) -> WindowBounds:
        """Return the smallest window that contains this one and another."""
        return WindowBounds(
            min(self.first_row, other.first_row),
            max(self.end_row, other.end_row),
            min(self.first_col, other.first_col),
            max(self.end_col, other.end_col),
        )

    def expanded(self, margin: int, shape: tuple[int, int]) -> WindowBounds:
        """Return the window with a margin [cells] around it, clipped to a map of a shape."""
        return WindowBounds(
            max(self.first_row - margin, 0),
            min(self.end_row + margin, shape[0]),
            max(self.first_col - margin, 0),
            min(self.end_col + margin, shape[1]),
        )


@kernel
def _enclose(cells, cols):  # type: ignore[no-untyped-def]
    """Return first row, end row, first column and end column of flat indices."""
    first_row, end_row = cells[0] // cols, cells[0] // cols + 1
    first_col, end_col = cols, 0
    for i in cells:
        row = i // cols
        col = i - row * cols
        first_row, end_row = min(first_row, row), max(end_row, row + 1)
        first_col, end_col = min(first_col, col), max(end_col, col + 1)
    return first_row, end_row, first_col, end_col
