"""Landing: a particle's volume goes to the four nearest grid points (reference, section 3.1).

The shares are bilinear weights of the landing point, rounded to whole mm^3 so that they add up to
exactly the particle's volume.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import ConversionKind, Rows
from msg_bridge.kernels import kernel

__all__ = ["ColumnShares", "bilinear_shares"]

_DEPOSIT = int(ConversionKind.DEPOSIT)


class ColumnShares(NamedTuple):
    """Soil that comes to columns, four shares for each particle.

    Attributes:
        cells: flat indices, shape (n,).
        volume_mm3: bank volumes, shape (n,); some may be 0.
        soil: ids of its kind, shape (n,).
        moisture: of it [%], shape (n,).
    """

    cells: NDArray[np.int64]
    volume_mm3: NDArray[np.int64]
    soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]


def bilinear_shares(grid: Grid, conversions: Rows) -> ColumnShares:
    """Which columns particles that land go to, and how much each of them gets.

    Args:
        grid: of the terrain.
        answers: CONVERSION rows; those of the kind DEPOSIT are shared out.
    """
    shares: ColumnShares = _bilinear_shares(
        conversions, grid.rows, grid.cols, grid.cell, grid.x_first, grid.y_first
    )
    return shares


@kernel
def _bilinear_shares(conversions, rows, cols, cell, x_first, y_first):  # type: ignore[no-untyped-def]
    """`Shares` of the DEPOSIT rows."""
    count = 0
    for n in range(conversions.size):
        count += 4 * (conversions[n].kind == _DEPOSIT)
    cells, volume = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    soil, moisture = np.empty(count, dtype=np.uint8), np.empty(count, dtype=np.uint8)
    end = 0
    for n in range(conversions.size):
        landed = conversions[n]
        if landed.kind != _DEPOSIT:
            continue
        # Half a cell beyond the outer grid points still belongs to the outer columns.
        u = min(max((x_first - np.float64(landed.x)) / cell, 0.0), rows - 1.0)
        v = min(max((y_first - np.float64(landed.y)) / cell, 0.0), cols - 1.0)
        i = min(np.int64(u), rows - 2)
        j = min(np.int64(v), cols - 2)
        u -= i
        v -= j
        total = np.int64(landed.volume_mm3)
        left = total
        for k in range(4):
            down, across = k // 2, k % 2
            part = total * (u if down else 1.0 - u) * (v if across else 1.0 - v)
            share = np.int64(part) if k < 3 else left  # the last one takes what rounding left
            left -= share
            volume[end] = share
            cells[end] = (i + down) * cols + j + across
            soil[end], moisture[end] = landed.soil, landed.moisture
            end += 1
    return ColumnShares(cells, volume, soil, moisture)
