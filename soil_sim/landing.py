"""Landing: a particle's volume goes to the four nearest grid points (reference, section 3.1).

The shares are bilinear weights of the landing point, rounded to whole mm^3 so that they add up to
exactly the particle's volume.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid

__all__ = ["landing_shares"]


def landing_shares(
    grid: Grid,
    x: NDArray[np.floating],
    y: NDArray[np.floating],
    volume_mm3: NDArray[np.integer],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which columns particles that land go to, and how much each of them gets.

    Args:
        grid: of the terrain.
        x, y: landing points on the map [m], map frame, shape (n,).
        volume_mm3: bank volumes, shape (n,).

    Returns:
        (flat indices, bank volumes [mm^3]), shape (n, 4) each; some volumes may be 0.
    """
    cells, shares = np.empty((2, x.size, 4), dtype=np.int64)
    volume = volume_mm3.astype(np.int64)
    _share(grid.rows, grid.cols, grid.row(x), grid.col(y), volume, cells, shares)
    return cells, shares


@njit(cache=True)
def _share(rows, cols, row, col, volume, cells, shares):  # type: ignore[no-untyped-def]
    """Share out `volume` [mm^3] at fractional indices (row, col)."""
    for n in range(row.size):
        # Half a cell beyond the outer grid points still belongs to the outer columns.
        u = min(max(row[n], 0.0), rows - 1.0)
        v = min(max(col[n], 0.0), cols - 1.0)
        i = min(np.int64(u), rows - 2)
        j = min(np.int64(v), cols - 2)
        u -= i
        v -= j
        total = volume[n]
        shares[n, 0] = np.int64(total * (1.0 - u) * (1.0 - v))
        shares[n, 1] = np.int64(total * (1.0 - u) * v)
        shares[n, 2] = np.int64(total * u * (1.0 - v))
        shares[n, 3] = total - shares[n, :3].sum()
        first = i * cols + j
        cells[n, 0] = first
        cells[n, 1] = first + 1
        cells[n, 2] = first + cols
        cells[n, 3] = first + cols + 1
