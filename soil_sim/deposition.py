"""Deposition: particles that came to rest become loose soil of the terrain again.

The volume of a particle is divided among its four nearest columns (section 3.1 of the reference).
The shares are the bilinear weights of the landing point, rounded to whole mm^3 such that they add
up to exactly the volume of the particle. `slope_failure.runout` adds them to the columns, and soil
that is deposited on a slope runs down it.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.contract.rows import ConversionKind, Rows
from msg_bridge.kernels import kernel
from soil_sim.columns.grid_frame import GridFrame
from soil_sim.slope_failure.relaxation import SlopeRelaxation
from soil_sim.slope_failure.runout import ColumnShares

__all__ = ["bilinear_shares", "deposit"]

_DEPOSIT = int(ConversionKind.DEPOSIT)


def deposit(
    relaxation: SlopeRelaxation, frame: GridFrame, conversions: Rows, max_cell_visits: int
) -> int:
    """Turn the deposited particles among conversion rows into loose soil of the columns.

    Args:
        relaxation: the slopes of the terrain, whose columns get the soil.
        frame: grid of the terrain.
        conversions: CONVERSION rows; those of the kind DEPOSIT are deposited.
        max_cell_visits: maximum number of steps of runout, see `SlopeRelaxation`.

    Returns:
        The number of steps of runout.
    """
    if conversions.size == 0:
        return 0
    return relaxation.deposit_with_runout(bilinear_shares(frame, conversions), max_cell_visits)


def bilinear_shares(frame: GridFrame, conversions: Rows) -> ColumnShares:
    """Return the shares of the columns around deposited particles, four for each DEPOSIT row.

    Args:
        frame: grid of the terrain.
        conversions: CONVERSION rows; those of the kind DEPOSIT are distributed.
    """
    shares: ColumnShares = _bilinear_shares(conversions, frame)
    return shares


@kernel
def _bilinear_shares(conversions, frame):  # type: ignore[no-untyped-def]
    count = 0
    for n in range(conversions.size):
        count += 4 * (conversions[n].kind == _DEPOSIT)
    cells, volume = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    soil, moisture = np.empty(count, dtype=np.uint8), np.empty(count, dtype=np.uint8)
    end = 0
    for n in range(conversions.size):
        particle = conversions[n]
        if particle.kind != _DEPOSIT:
            continue
        # The half cell beyond the outer grid points belongs to the outer columns.
        u = min(max((frame.x_first - np.float64(particle.x)) / frame.cell, 0.0), frame.rows - 1.0)
        v = min(max((frame.y_first - np.float64(particle.y)) / frame.cell, 0.0), frame.cols - 1.0)
        i = min(np.int64(u), frame.rows - 2)
        j = min(np.int64(v), frame.cols - 2)
        u -= i
        v -= j
        total = np.int64(particle.volume_mm3)
        remaining = total
        for k in range(4):
            down, across = k // 2, k % 2
            exact = total * (u if down else 1.0 - u) * (v if across else 1.0 - v)
            share = np.int64(exact) if k < 3 else remaining  # the last one gets the rounding errors
            remaining -= share
            volume[end] = share
            cells[end] = (i + down) * frame.cols + j + across
            soil[end], moisture[end] = particle.soil, particle.moisture
            end += 1
    return ColumnShares(cells, volume, soil, moisture)
