"""Recover the grid from the float32 positions of its cell centres.

A cloud does not state the side length of a cell. Its positions are multiples of it, rounded to
float32, so they bound it to an interval. The side length is the number with the fewest digits in
the interval that reproduces all positions exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode, ParameterError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import Rows

__all__ = ["cell_positions", "grid_of_cells"]

_MAX_DIGITS = 17
"""Number of significant digits that identify every float64."""


def cell_positions(grid: Grid) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return x of the rows, shape (rows, 1), and y of the columns, shape (1, cols) [m]."""
    x = grid.x(np.arange(grid.rows)).astype(np.float32)
    y = grid.y(np.arange(grid.cols)).astype(np.float32)
    return x[:, None], y[None, :]


def grid_of_cells(cells: Rows, cell: float | None) -> Grid:
    """Return the grid with these cell centres.

    Args:
        cells: points with the fields x and y [m], shape (rows, cols).
        cell: side length of a cell [m]; None to estimate it.

    Raises:
        CodecError: GRID: there is no such grid around the origin.
    """
    rows, cols = cells.shape
    estimate = _estimate_cell(cells["x"][:, 0], cells["y"][0])
    digits = range(1, _MAX_DIGITS + 1)
    candidates = [float(f"{estimate:.{n}g}") for n in digits] if cell is None else [cell]
    for candidate in candidates:
        try:
            grid = Grid(rows, cols, candidate)
        except ParameterError:
            continue
        x, y = cell_positions(grid)
        # The corner first: most candidates fail there.
        if cells["x"][0, 0] == x[0, 0] and (cells["x"] == x).all() and (cells["y"] == y).all():
            return grid
    wanted = "equal size" if cell is None else f"{cell} m"
    raise CodecError(
        f"the cloud's x and y are not the centres of {rows} x {cols} cells of {wanted} around the"
        " origin, beginning at +x, +y",
        ErrorCode.GRID,
    )


def _estimate_cell(*axes: NDArray[np.float32]) -> float:
    """Return the middle of the interval of side lengths [m] that round to these positions.

    Args:
        axes: positions of the rows and of the columns [m].
    """
    position = np.concatenate(axes)
    steps = np.concatenate([0.5 * (axis.size - 1) - np.arange(axis.size) for axis in axes])
    is_off_centre = steps != 0.0
    position, steps = position[is_off_centre], steps[is_off_centre]
    with np.errstate(invalid="ignore"):  # positions may be anything: the estimate is verified
        nearest = position.astype(np.float64) / steps
        spread = 0.5 * np.spacing(np.abs(position)).astype(np.float64) / np.abs(steps)
        return 0.5 * float(np.max(nearest - spread) + np.min(nearest + spread))
