"""Columns that a tool is in, refined into subcolumns with heights of their own.

The data of a refined column are in a slot of tables that grow as needed; most columns of a map are
never refined.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import BoxedTable, box_table, fixed_signature_kernel

__all__ = [
    "MOMENT_X",
    "MOMENT_Y",
    "MOMENT_Z",
    "REMOVED_HEIGHT",
    "RefinedArrays",
    "RefinedColumns",
]

REMOVED_HEIGHT, MOMENT_X, MOMENT_Y, MOMENT_Z = range(4)
"""Fields of `RefinedArrays.removed_moments`."""

_NUM_MOMENTS = 4

_INITIAL_SLOTS = 256

_NO_CELLS: NDArray[np.int64] = np.zeros(0, dtype=np.int64)


class RefinedArrays(NamedTuple):
    """Tables of refined columns, for kernels.

    Attributes:
        slot_of: slot of each column of the map, -1 if it is not refined, shape (columns,), int64.
        cells: flat index of the column in each slot, shape (slots,), int64.
        last_tick: last tick in which a tool was in the column, shape (slots,), int64.
        subcolumn_height: heights of its subcolumns [m], shape (slots, subcolumns_per_side**2),
            row-major, float64.
        mean_height: mean of those, equal to the height of the column [m], shape (slots,), float64.
        initial_height: surface of the column when the tool entered it [m], shape (slots,), float64.
        removed_moments: height removed in this sweep, summed over the subcolumns [m], and its first
            moments along x, y, z [m^2], shape (slots, 4), float64.
    """

    slot_of: NDArray[np.int64]
    cells: NDArray[np.int64]
    last_tick: NDArray[np.int64]
    subcolumn_height: NDArray[np.float64]
    mean_height: NDArray[np.float64]
    initial_height: NDArray[np.float64]
    removed_moments: NDArray[np.float64]


class RefinedColumns:
    """Allocates slots for refined columns, and frees them.

    Attributes:
        subcolumns_per_side: number of subcolumns along a side of a column.
        count: number of slots in use, which are the first ones.
        tick: number of the current tick.
        arrays, boxed_arrays: the tables.
    """

    def __init__(self, columns: int, subcolumns_per_side: int) -> None:
        """
        Args:
            columns: number of columns of the map.
            subcolumns_per_side: number of subcolumns along a side of a column.
        """
        self.subcolumns_per_side = subcolumns_per_side
        self.count = 0
        self.tick = 0
        self.arrays = _allocate(
            np.full(columns, -1, dtype=np.int64),
            _INITIAL_SLOTS,
            subcolumns_per_side,
        )
        self.boxed_arrays: BoxedTable = box_table(self.arrays)

    @property
    def capacity(self) -> int:
        """Number of slots."""
        return self.arrays.cells.size

    def reserve(self, more: int) -> bool:
        """Allocate slots for `more` columns to refine, at most all columns of the map.

        Returns:
            Whether the tables were replaced by larger ones.
        """
        old, used = self.arrays, self.count
        more = min(more, old.slot_of.size - used)
        if used + more <= self.capacity:
            return False
        slots = max(used + more, 2 * self.capacity)
        new = _allocate(old.slot_of, slots, self.subcolumns_per_side)
        for table, previous in zip(_slot_tables(new), _slot_tables(old), strict=True):
            table[:used] = previous[:used]
        self.arrays, self.boxed_arrays = new, box_table(new)
        return True

    def end_tick(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """End the tick: free the slots of columns that no tool was in.

        Returns:
            (columns still refined, columns freed), flat indices; the latter sorted.
        """
        freed = _NO_CELLS
        if self.count:
            self.count, freed = _free_unused_slots(self.boxed_arrays, self.count, self.tick)
            freed.sort()
        self.tick += 1
        return self.arrays.cells[: self.count].copy(), freed


def _allocate(slot_of: NDArray[np.int64], slots: int, subcolumns_per_side: int) -> RefinedArrays:
    return RefinedArrays(
        slot_of=slot_of,
        cells=np.zeros(slots, dtype=np.int64),
        last_tick=np.zeros(slots, dtype=np.int64),
        subcolumn_height=np.zeros((slots, subcolumns_per_side**2)),
        mean_height=np.zeros(slots),
        initial_height=np.zeros(slots),
        removed_moments=np.zeros((slots, _NUM_MOMENTS)),
    )


def _slot_tables(arrays: RefinedArrays) -> tuple[NDArray[np.generic], ...]:
    """Return the tables with a row for each slot."""
    return (
        arrays.cells,
        arrays.last_tick,
        arrays.subcolumn_height,
        arrays.mean_height,
        arrays.initial_height,
        arrays.removed_moments,
    )


@fixed_signature_kernel
def _free_unused_slots(boxed_arrays, count, tick):  # type: ignore[no-untyped-def]
    """Free the slots of columns that no tool was in, and close the gaps.

    What a sweep removed is not moved along: every sweep begins by resetting it.

    Returns:
        (number of slots in use, flat indices of the freed columns).
    """
    slot_of, cells, last_tick, subcolumn_height, mean_height, initial_height, _ = boxed_arrays.table
    freed = np.empty(count, dtype=np.int64)
    kept = 0
    for slot in range(count):
        cell = cells[slot]
        if last_tick[slot] != tick:
            slot_of[cell] = -1
            freed[slot - kept] = cell
            continue
        slot_of[cell] = kept
        cells[kept], last_tick[kept] = cell, tick
        mean_height[kept] = mean_height[slot]
        initial_height[kept] = initial_height[slot]
        for q in range(subcolumn_height.shape[1]):
            subcolumn_height[kept, q] = subcolumn_height[slot, q]
        kept += 1
    return kept, freed[: count - kept]
