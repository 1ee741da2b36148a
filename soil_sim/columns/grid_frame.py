"""Size and position of the grid as a tuple that kernels can take."""

from __future__ import annotations

from typing import NamedTuple

from msg_bridge.contract.grid import Grid

__all__ = ["GridFrame", "grid_frame"]


class GridFrame(NamedTuple):
    """The fields of `Grid` that kernels need.

    Attributes:
        rows, cols: number of columns of soil along x and y.
        cell: side length of a column [m].
        x_first, y_first: centre of column (0, 0) [m], map frame.
    """

    rows: int
    cols: int
    cell: float
    x_first: float
    y_first: float


def grid_frame(grid: Grid) -> GridFrame:
    """Return the frame of a grid."""
    return GridFrame(grid.rows, grid.cols, grid.cell, grid.x_first, grid.y_first)
