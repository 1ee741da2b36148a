"""Landing: a particle's volume goes to the four nearest grid points (reference, section 3.1).

The shares are bilinear weights of the landing point, rounded to whole mm^3 so that they add up to
exactly the particle's volume.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from soil_sim.columns import Columns, add_loose

__all__ = ["deposit"]


def deposit(
    columns: Columns,
    x: NDArray[np.floating],
    y: NDArray[np.floating],
    volume_mm3: NDArray[np.integer],
    soil: NDArray[np.integer],
    moisture: NDArray[np.integer],
) -> NDArray[np.int64]:
    """Add landed volumes to the terrain.

    Args:
        columns: the terrain; changed.
        x, y: landing points on the map [m], map frame, shape (n,).
        volume_mm3: bank volumes, shape (n,).
        soil: ids of the kinds of soil, shape (n,).
        moisture: [%], shape (n,).

    Returns:
        Flat indices of the columns touched, shape (4 n,).
    """
    touched = np.empty(4 * x.size, dtype=np.int64)
    _deposit(
        columns.arrays,
        columns.grid.rows,
        columns.grid.cols,
        columns.grid.row(x),
        columns.grid.col(y),
        volume_mm3.astype(np.int64),
        soil.astype(np.uint8),
        moisture.astype(np.uint8),
        touched,
    )
    return touched


@njit(cache=True)
def _deposit(columns, rows, cols, row, col, volume, soil, moisture, touched):  # type: ignore[no-untyped-def]
    """Share out `volume` [mm^3] at fractional indices (row, col); notes the columns touched."""
    for n in range(row.size):
        # Half a cell beyond the outer grid points still belongs to the outer columns.
        u = min(max(row[n], 0.0), rows - 1.0)
        v = min(max(col[n], 0.0), cols - 1.0)
        i = min(np.int64(u), rows - 2)
        j = min(np.int64(v), cols - 2)
        u -= i
        v -= j
        total = volume[n]
        a = np.int64(total * (1.0 - u) * (1.0 - v))
        b = np.int64(total * (1.0 - u) * v)
        c = np.int64(total * u * (1.0 - v))
        d = total - a - b - c
        first = i * cols + j
        for share, k in ((a, first), (b, first + 1), (c, first + cols), (d, first + cols + 1)):
            if share > 0:
                bulk = np.int64(share * columns.growth[soil[n]] + 0.5)
                add_loose(columns, k, share, bulk, soil[n], moisture[n])
        touched[4 * n] = first
        touched[4 * n + 1] = first + 1
        touched[4 * n + 2] = first + cols
        touched[4 * n + 3] = first + cols + 1
