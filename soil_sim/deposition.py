"""Deposition: particles that came to rest become loose soil of the terrain again.

The volume of a particle is divided among its four nearest columns (section 3.1 of the reference).
The shares are the bilinear weights of the landing point, rounded to whole mm^3 such that they add
up to exactly the volume of the particle. `slope_failure.runout` adds them to the columns, and soil
that is deposited on a slope runs down it.

Columns that a tool is in get no share: the soil would lie above the surface of the tool, and a tool
at rest would cut it again in the next tick. If a tool is in all four columns, all soil goes to one
column: of those with neither a tool nor a track, the one that is nearest to the column in which the
particle came to rest, or that column itself if there is none near (`nearest_free_column`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import ConversionKind, Rows
from msg_bridge.kernels import fixed_signature_kernel
from soil_sim.columns.grid_frame import GridFrame
from soil_sim.columns.occupancy import TOOL_INSIDE
from soil_sim.excavation.displacement import nearest_free_column
from soil_sim.slope_failure.relaxation import SlopeRelaxation
from soil_sim.slope_failure.runout import ColumnShares, join_shares

__all__ = ["bilinear_shares", "deposit"]

_DEPOSIT = int(ConversionKind.DEPOSIT)


def deposit(
    relaxation: SlopeRelaxation,
    frame: GridFrame,
    conversions: Rows,
    displaced: ColumnShares | None,
    max_cell_visits: int,
) -> int:
    """Turn deposited particles and displaced soil into loose soil of the columns.

    Args:
        relaxation: the slopes of the terrain, whose columns get the soil.
        frame: grid of the terrain.
        conversions: CONVERSION rows; those of the kind DEPOSIT are deposited.
        displaced: soil that tools have pushed ahead; None for none.
        max_cell_visits: maximum number of steps of runout, see `SlopeRelaxation`.

    Returns:
        The number of steps of runout.
    """
    parts = []
    if conversions.size:
        parts.append(bilinear_shares(frame, conversions, relaxation.occupied))
    if displaced is not None:
        parts.append(displaced)
    if not parts:
        return 0
    shares = parts[0] if len(parts) == 1 else join_shares(parts)
    return relaxation.deposit_with_runout(shares, max_cell_visits)


def bilinear_shares(
    frame: GridFrame, conversions: Rows, occupied: NDArray[np.uint8]
) -> ColumnShares:
    """Return the shares of the columns around deposited particles, four for each DEPOSIT row.

    Args:
        frame: grid of the terrain.
        conversions: CONVERSION rows; those of the kind DEPOSIT are distributed.
        occupied: marks of `columns.occupancy`, shape (rows, cols).
    """
    shares: ColumnShares = _bilinear_shares(conversions, frame, occupied.reshape(-1))
    return shares


@fixed_signature_kernel
def _bilinear_shares(conversions, frame, occupied):  # type: ignore[no-untyped-def]
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
        free_weight, last_free = 0.0, -1
        for k in range(4):
            if occupied[(i + k // 2) * frame.cols + j + k % 2] != TOOL_INSIDE:
                free_weight += (u if k // 2 else 1.0 - u) * (v if k % 2 else 1.0 - v)
                last_free = k
        for k in range(4):
            down, across = k // 2, k % 2
            cell = (i + down) * frame.cols + j + across
            share = np.int64(0)
            if k == last_free:
                share = remaining  # the last one gets the rounding errors
            elif occupied[cell] != TOOL_INSIDE and free_weight > 0.0:
                weight = (u if down else 1.0 - u) * (v if across else 1.0 - v)
                share = min(np.int64(total * (weight / free_weight)), remaining)
            elif last_free < 0 and k == 0:
                landed_in = (i + (u >= 0.5)) * frame.cols + j + (v >= 0.5)
                cell = nearest_free_column(landed_in, occupied, frame)
                share = remaining
            remaining -= share
            volume[end] = share
            cells[end] = cell
            soil[end], moisture[end] = particle.soil, particle.moisture
            end += 1
    return ColumnShares(cells, volume, soil, moisture)
