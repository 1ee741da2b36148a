"""Spatial hashing of particles: a counting sort of their rows into cubic cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleState
from msg_bridge.kernels import helper, kernel

__all__ = ["CellGrid", "rows_in_box", "sort_into_cells", "spatial_order"]

_SORT_CELL_RADII = 2.2
"""Cell size of `spatial_order`, in maximum radii."""
_EXTENT_DEVIATIONS = 3.0
"""Extent of the cells about the mean position, in standard deviations along each axis."""


class CellGrid(NamedTuple):
    """Rows sorted by cell; y varies slowest and z fastest, and the outermost cells are empty.

    Attributes:
        order: the rows, cell by cell, int32, shape (n,).
        start: first place in `order` of each cell, and the end, int32, shape (cells + 1,).
        cell: cell of each place in `order`, int32, shape (n,).
        shape: number of cells along x, y and z, int64, shape (3,). An array, as Numba cannot pass a
            tuple within a tuple to a parallel kernel.
    """

    order: NDArray[np.int32]
    start: NDArray[np.int32]
    cell: NDArray[np.int32]
    shape: NDArray[np.int64]


def spatial_order(state: ParticleState) -> NDArray[np.intp]:
    """Return the rows sorted by position, so that neighbours in space are neighbours in memory."""
    cell_size = _SORT_CELL_RADII * float(state.radius.max())
    grid = sort_into_cells(np.arange(state.count), state.position, cell_size)
    return np.asarray(grid.order, dtype=np.intp)


@helper(allocates=True)
def rows_in_box(position, moving, margin):  # type: ignore[no-untyped-def]
    """Return the rows of all particles in the bounding box of `moving` rows, enlarged by a margin.

    Args:
        position: centres [m], shape (n, 3).
        moving: rows that the box is put around.
        margin: distance by which the box is enlarged on each side [m].
    """
    low, high = np.full(3, 1e300), np.full(3, -1e300)
    for i in moving:
        for axis in range(3):
            low[axis] = min(low[axis], position[i, axis] - margin)
            high[axis] = max(high[axis], position[i, axis] + margin)
    rows = np.empty(position.shape[0], np.int64)
    count = 0
    for i in range(position.shape[0]):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        rows[count] = i
        count += (
            (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
            & (z >= low[2]) & (z <= high[2])
        )  # fmt: skip
    return rows[:count]


@kernel
def sort_into_cells(rows, position, cell_size):  # type: ignore[no-untyped-def]
    """Sort rows by cell with a counting sort.

    Only the bulk of the particles (3 standard deviations about the mean) gets cells of its own;
    particles beyond it are put into the outermost cells. That keeps the number of cells near that
    of particles, and never separates two neighbours, as it only brings cell indices closer
    together.

    Args:
        rows: rows to sort, int64.
        position: centres [m], shape (n, 3).
        cell_size: edge length of a cell [m].

    Returns:
        `CellGrid`.
    """
    n = rows.size
    low, shape = _grid_extent(rows, position, cell_size)
    nx, ny, nz = shape[0], shape[1], shape[2]
    inverse_size = 1.0 / cell_size
    cell_of_row = np.empty(n, np.int32)
    start = np.zeros(nx * ny * nz + 1, np.int32)
    for k in range(n):
        i = rows[k]
        # Clamped as floats first: a distant particle must not overflow the integer.
        x = int(min(max((position[i, 0] - low[0]) * inverse_size + 1.0, 1.0), nx - 2.0))
        y = int(min(max((position[i, 1] - low[1]) * inverse_size + 1.0, 1.0), ny - 2.0))
        z = int(min(max((position[i, 2] - low[2]) * inverse_size + 1.0, 1.0), nz - 2.0))
        x, y, z = min(max(x, 1), nx - 2), min(max(y, 1), ny - 2), min(max(z, 1), nz - 2)
        c = (y * nx + x) * nz + z
        cell_of_row[k] = c
        start[c + 1] += 1
    for c in range(nx * ny * nz):
        start[c + 1] += start[c]
    next_place = start[:-1].copy()
    order, cell = np.empty(n, np.int32), np.empty(n, np.int32)
    for k in range(n):
        c = cell_of_row[k]
        order[next_place[c]] = rows[k]
        cell[next_place[c]] = c
        next_place[c] += 1
    return CellGrid(order, start, cell, shape)


@helper(allocates=True)
def _grid_extent(rows, position, cell_size):  # type: ignore[no-untyped-def]
    """Return the low corner [m] of the inner cells and the number of cells along each axis."""
    n = rows.size
    low, shape = np.zeros(3), np.zeros(3, np.int64)
    for axis in range(3):
        total, lowest, highest = 0.0, 1e300, -1e300
        for i in rows:
            p = position[i, axis]
            total += p
            lowest, highest = min(lowest, p), max(highest, p)
        mean, square_sum = total / n, 0.0
        for i in rows:
            square_sum += (position[i, axis] - mean) ** 2
        spread = _EXTENT_DEVIATIONS * np.sqrt(square_sum / n)
        low[axis] = max(lowest, mean - spread)
        width = min(highest, mean + spread) - low[axis]
        shape[axis] = int(min(width / cell_size, 1e6)) + 3
    while shape[0] * shape[1] * shape[2] > 10 * n + 1000:
        for axis in range(3):
            shape[axis] = max(3, shape[axis] * 4 // 5)
    return low, shape
