"""Columns a tool stands in, refined into subcolumns with heights of their own.

A refined column has a slot in tables that grow as needed; most of a map never has one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import kernel

__all__ = ["RefinedArrays", "RefinedColumns"]


class RefinedArrays(NamedTuple):
    """The tables, for kernels.

    Attributes:
        slot_of: slot of each column, -1 without one, shape (columns,).
        cells: flat index of the column in each slot.
        seen: last tick a tool was in it.
        sub: heights of its subcolumns [m], shape (slots, subcolumns_per_side**2), row-major.
        mean: their mean, which is the column's height [m].
        top: the column's surface when the tool came [m].
        removed: height lost in this sweep, summed over subcolumns [m], and its first moments
            along x, y, z [m^2], shape (slots, 4).
    """

    slot_of: NDArray[np.int64]
    cells: NDArray[np.int64]
    last_tick: NDArray[np.int64]
    subcolumn_height: NDArray[np.float64]
    mean_height: NDArray[np.float64]
    initial_height: NDArray[np.float64]
    removed_moments: NDArray[np.float64]


class RefinedColumns:
    """The tables and their use.

    Attributes:
        subcolumns_per_side: subcolumns along a side of a column.
        count: slots in use, the first ones.
        tick: number of the tick being cut.
        arrays: the tables.
    """

    def __init__(self, columns: int, subcolumns_per_side: int) -> None:
        """
        Args:
            columns: number of columns of the map.
            subcolumns_per_side: subcolumns along a side of a column.
        """
        self.subcolumns_per_side = subcolumns_per_side
        self.count = 0
        self.tick = 0
        self.arrays = _allocate(np.full(columns, -1, dtype=np.int64), 256, subcolumns_per_side)

    def reserve(self, more: int) -> None:
        """Make room for `more` columns."""
        old = self.arrays
        more = min(more, old.slot_of.size - self.count)
        if self.count + more > old.cells.size:
            self.arrays = _allocate(
                old.slot_of, max(self.count + more, 2 * old.cells.size), self.subcolumns_per_side
            )
            for table, before in zip(self.arrays[1:], old[1:], strict=True):
                table[: self.count] = before[: self.count]

    def begin_sweep(self) -> None:
        """Begin a sweep, which has removed nothing; slots not in use are cleared when taken."""
        self.arrays.removed_moments[: self.count] = 0.0

    def end_tick(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """End the tick: free the slots of columns no tool was in.

        Returns:
            (columns still refined, columns freed), flat indices.
        """
        if self.count == 0:
            gone = np.zeros(0, dtype=np.int64)
        else:
            self.count, gone = _free_unused_slots(self.arrays, self.count, self.tick)
        self.tick += 1
        return self.arrays.cells[: self.count].copy(), np.sort(gone)


def _allocate(slot_of: NDArray[np.int64], slots: int, subcolumns_per_side: int) -> RefinedArrays:
    return RefinedArrays(
        slot_of,
        np.zeros(slots, dtype=np.int64),
        np.zeros(slots, dtype=np.int64),
        np.zeros((slots, subcolumns_per_side**2)),
        np.zeros(slots),
        np.zeros(slots),
        np.zeros((slots, 4)),
    )


@kernel
def _free_unused_slots(tables, count, tick):  # type: ignore[no-untyped-def]
    """Free the slots that no tool was in; returns (slots in use, columns freed)."""
    slot_of, cells, last_tick, subcolumn_height, mean_height, initial_height, _ = tables
    gone = np.empty(count, dtype=np.int64)
    kept = 0
    for slot in range(count):
        cell = cells[slot]
        if last_tick[slot] != tick:
            slot_of[cell] = -1
            gone[slot - kept] = cell
            continue
        # What a sweep removed is not kept: the next one begins with none.
        slot_of[cell] = kept
        cells[kept], last_tick[kept] = cell, tick
        mean_height[kept], initial_height[kept] = mean_height[slot], initial_height[slot]
        for q in range(subcolumn_height.shape[1]):
            subcolumn_height[kept, q] = subcolumn_height[slot, q]
        kept += 1
    return kept, gone[: count - kept]
