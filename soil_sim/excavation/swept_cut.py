"""Swept cutting: a tool removes the soil its lower surface sweeps, weighted by area.

A column is often wider than the way a tool moves in a tick. While a tool stands in a column, the
column is therefore refined into subcolumns, each with its own height; the tool's surface is
painted into them through the tick (`soil_sim.excavation.rasterize`), and the column loses the mean of what they
lose. So a cut takes the same volume on a coarse grid as on a fine one, and however fast the tool
moves.

While any part of the tool is in it, below where its surface was, a column is *held*: soil does
not slip into the room the tool fills. When no part of any tool was in it for a tick, the column is
whole again: it is levelled to the mean of its subcolumns, and the shape a cut had within it is
forgotten. A tool that comes back to a half cut column therefore meets it at half the depth.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import kernel
from soil_sim.columns.state import Columns, mix_moisture, remove_from_column
from soil_sim.excavation.rasterize import SubcolumnGrid, max_columns_touched, rasterize_sweep
from soil_sim.excavation.refined_columns import RefinedColumns
from soil_sim.tool_sweeps import SweptPairs

__all__ = ["RemovedSoil", "SweptCut"]

RemovedSoil = NDArray[np.float64]
"""Soil removed from columns, shape (n, 7): flat index, volume [mm^3 bank], centroid x, y, z [m], id
of the kind of soil: the firm's, where most of it was firm; moisture [%]: of the loose and the firm
together, by volume, as in `soil_sim.columns.state`."""


class SweptCut:
    """Removes what tools sweep; remembers the columns they stand in.

    Attributes:
        held: columns a tool stands in, shape (rows, cols), uint8; shared with the slip.
    """

    def __init__(self, columns: Columns, occupied: NDArray[np.uint8], *, resolution: float) -> None:
        """
        Args:
            columns: the terrain this cuts.
            held: marked 1 where a tool stands.
            resolution: size of a subcolumn [m], at most; never more than half the cell.
        """
        self._columns = columns
        self.occupied = occupied
        grid = columns.grid
        subcolumns_per_side = max(2, int(np.ceil(grid.cell / resolution - 1e-9)))
        self._subgrid = SubcolumnGrid(
            grid.rows, grid.cols, grid.cell, grid.x_first, grid.y_first, subcolumns_per_side
        )
        self._refined = RefinedColumns(columns.height.size, subcolumns_per_side)

    def reserve(self, strokes: Iterable[SweptPairs]) -> None:
        """Make room for all sweeps of a tick, before the first of them cuts."""
        self._refined.reserve(
            sum(int(max_columns_touched(*pairs, self._subgrid)) for pairs in strokes)
        )

    def excavate(self, pairs: SweptPairs) -> RemovedSoil:
        """Cut one source's tick of tool motion; `reserve` goes before, `release` ends the tick.

        Args:
            pairs: key-point pairs of sound rows.

        Returns:
            What was removed, per column.
        """
        refined = self._refined
        refined.begin_sweep()
        columns, tables = self._columns.arrays, refined.arrays
        refined.count = rasterize_sweep(
            *pairs,
            columns.height,
            columns.floor,
            tables,
            self._subgrid,
            refined.count,
            refined.tick,
        )
        if refined.count == 0:  # in the air
            return np.zeros((0, 7))
        removed: RemovedSoil = _remove_from_columns(
            columns, tables, refined.count, refined.subcolumns_per_side**2
        )
        return removed

    def end_tick(self) -> NDArray[np.int64]:
        """End the tick: hold the columns a tool was in, make the others whole again.

        Returns:
            Flat indices of the columns the tools have left.
        """
        stay, gone = self._refined.end_tick()
        occupied = self.occupied.reshape(-1)
        occupied[gone] = 0
        occupied[stay] = 1
        return gone


@kernel
def _remove_from_columns(columns, refined, count, parts):  # type: ignore[no-untyped-def]
    """Take the painted removal out of the columns, as whole mm^3 of bank volume."""
    cells, subcolumn_height, mean_height, removed = (
        refined.cells,
        refined.subcolumn_height,
        refined.mean_height,
        refined.removed_moments,
    )
    out = np.empty((count, 7))
    n = 0
    for slot in range(count):
        if removed[slot, 0] <= 0.0:
            continue
        i = cells[slot]
        bulk = removed[slot, 0] / parts / columns.metres_per_mm3
        soil = columns.loose_soil[i]
        loose, firm = remove_from_column(columns, i, bulk)
        bank = loose + firm
        # What rounding left standing is spread evenly, so the subcolumns' mean stays the height.
        rounding = columns.height[i] - (mean_height[slot] - removed[slot, 0] / parts)
        for q in range(parts):
            subcolumn_height[slot, q] += rounding
        mean_height[slot] = columns.height[i]
        if bank > 0:
            out[n, 0] = i
            out[n, 1] = bank
            out[n, 2] = removed[slot, 1] / removed[slot, 0]
            out[n, 3] = removed[slot, 2] / removed[slot, 0]
            out[n, 4] = removed[slot, 3] / removed[slot, 0]
            out[n, 5] = columns.soil[i] if firm > loose else soil
            wet = columns.loose_moisture[i]  # taking does not change it
            out[n, 6] = mix_moisture(loose, wet, firm, columns.moisture[i])
            n += 1
    return out[:n]
