"""Neighbourhood of a column: the lattice points within a circle, and the columns between.

Soil slides over several columns at once, but not through a tool: none goes to a neighbour if the
straight line to it passes a column that a tool is in.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper
from soil_sim.columns.occupancy import TOOL_INSIDE

__all__ = ["columns_between", "gauss_circle_offsets", "is_tool_between"]


def gauss_circle_offsets(radius: float) -> NDArray[np.int64]:
    """Return the offsets (row, col) of the lattice points within `radius` cells of the origin.

    The origin is excluded. Shape (n, 2), sorted by distance, then by direction. n is 4, 8, 12, 20,
    24, 28, 36, 44, 48 for r = 1, sqrt 2, 2, sqrt 5, 2 sqrt 2, 3, sqrt 10, sqrt 13, 4 (Table 1 of
    the reference has 42 and 46 for the last two; counting the lattice points gives 44 and 48).
    """
    reach = int(math.floor(radius + 1e-9))
    points = [
        (di, dj)
        for di in range(-reach, reach + 1)
        for dj in range(-reach, reach + 1)
        if 0 < di * di + dj * dj <= radius * radius + 1e-9
    ]
    points.sort(key=lambda p: (p[0] ** 2 + p[1] ** 2, math.atan2(p[1], p[0])))
    return np.array(points, dtype=np.int64)


def columns_between(offsets: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the columns that the lines to neighbours pass.

    Args:
        offsets: (row, col) of the neighbours [cells], shape (n, 2).

    Returns:
        (row, col) of pairs of columns [cells], shape (n, m, 2, 2): twice the same column, or the
        two between which a line goes through their common corner. Padded by (0, 0).
    """
    pairs_to = [_pairs_between(int(di), int(dj)) for di, dj in offsets]
    between = np.zeros((len(pairs_to), max(1, *map(len, pairs_to)), 2, 2), dtype=np.int64)
    for k, pairs in enumerate(pairs_to):
        between[k, : len(pairs)] = np.array(pairs, dtype=np.int64).reshape(-1, 2, 2)
    return between


def _pairs_between(di: int, dj: int) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return pairs of (row, col) of the columns that the line from (0, 0) to (di, dj) passes."""
    rows, cols = abs(di), abs(dj)
    row_step, col_step = (1 if di > 0 else -1), (1 if dj > 0 else -1)
    pairs = []
    i = j = 0
    while (i, j) != (rows, cols):
        # The line leaves the column through a side at (i + 1/2) / rows or (j + 1/2) / cols of it.
        to_row, to_col = (2 * i + 1) * cols, (2 * j + 1) * rows
        if cols == 0 or (rows > 0 and to_row < to_col):
            i += 1
        elif rows == 0 or to_col < to_row:
            j += 1
        else:
            pairs.append(((i + 1, j), (i, j + 1)))
            i, j = i + 1, j + 1
        if (i, j) != (rows, cols):
            pairs.append(((i, j), (i, j)))
    return [
        ((a * row_step, b * col_step), (c * row_step, d * col_step)) for (a, b), (c, d) in pairs
    ]


@helper(forceinline=True)
def is_tool_between(occupied, between, i, k):  # type: ignore[no-untyped-def]
    """Return whether a tool is between column i and its neighbour k.

    Args:
        occupied: marks of `columns.occupancy`, flat, uint8.
        between: columns of `columns_between` as offsets of flat indices, shape (n, m, 2).
        i: flat index of the column, in which there is no tool.
        k: number of the neighbour.
    """
    for n in range(between.shape[1]):
        if (
            occupied[i + between[k, n, 0]] == TOOL_INSIDE
            and occupied[i + between[k, n, 1]] == TOOL_INSIDE
        ):
            return True
    return False
