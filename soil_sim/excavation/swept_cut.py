"""Swept cut: a tool removes the soil that its lower surface sweeps, weighted by area.

A column is often wider than the distance a tool moves in a tick. While a tool is in a column, the
column is therefore refined into subcolumns with heights of their own; the surface of the tool is
rasterized to them through the tick (`soil_sim.excavation.rasterize`), and the column loses the mean
of what they lose. A cut therefore removes the same volume on a coarse grid as on a fine one, at any
speed of the tool.

While any part of the tool is in a column, below the original surface, the column is *occupied*:
soil does not slide into the space that the tool fills. When no tool was in it for a tick, the
column is levelled to the mean of its subcolumns, and the shape of the cut within it is discarded. A
tool that returns to a column that it cut halfway therefore meets soil at half the depth.

Rock is removed only as far as the work of the resistance to cutting suffices (`rock_cut`).

A tool without room for all of the soil pushes the rest ahead (`soil_sim.excavation.displacement`).
A tool at rest takes in nothing: soil that slides or falls on the columns under it is pushed aside.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import UNLIMITED_ROOM
from msg_bridge.kernels import BoxedTable, box_table, fixed_signature_kernel, helper, kernel
from soil_sim.columns.occupancy import FREE, TOOL_INSIDE
from soil_sim.columns.operations import mix_moisture, remove_from_column
from soil_sim.columns.state import Columns
from soil_sim.excavation.displacement import Displacement, split_by_room
from soil_sim.excavation.milled_cut import Milling, mill_sweep
from soil_sim.excavation.rasterize import max_columns_touched, rasterize_sweep
from soil_sim.excavation.rasterize_triangle import RasterTables, SubcolumnGrid, raster_in_tick
from soil_sim.excavation.refined_columns import (
    MOMENT_X,
    MOMENT_Y,
    MOMENT_Z,
    REMOVED_HEIGHT,
    RefinedColumns,
)
from soil_sim.excavation.removed_soil import REMOVED_SOIL, RemovedSoil
from soil_sim.excavation.rock_cut import cut_sweep_in_rock
from soil_sim.slope_failure.runout import ColumnShares
from soil_sim.tool_sweeps import CutSweep

__all__ = ["SweptCut"]

_MIN_DISPLACEMENT = 1e-4
"""Displacement of a key point in a tick [m] below which a tool is at rest."""


class SweptCut:
    """Removes the soil that tools sweep, and keeps the columns that they are in.

    Attributes:
        occupied: marks of `columns.occupancy`, shape (rows, cols), uint8; shared with the slope
            relaxation.
    """

    def __init__(
        self,
        columns: Columns,
        occupied: NDArray[np.uint8],
        *,
        resolution: float,
    ) -> None:
        """
        Args:
            columns: terrain to cut.
            occupied: layer in which to mark the columns that a tool is in, shape (rows, cols).
            resolution: maximum size of a subcolumn [m]; never more than half the cell.
        """
        self._columns = columns
        self.occupied = occupied
        subcolumns_per_side = max(2, int(np.ceil(columns.grid.cell / resolution - 1e-9)))
        self._grid = SubcolumnGrid(*columns.frame, subcolumns_per_side)
        self._refined = RefinedColumns(columns.height.size, subcolumns_per_side)
        self._raster: BoxedTable = self._box_raster()
        self._displacement = Displacement(columns, occupied)

    @property
    def capacity(self) -> int:
        """Number of columns that can be refined without allocating memory."""
        return self._refined.capacity

    def reserve(self, sweeps: Iterable[CutSweep]) -> None:
        """Allocate memory for all sweeps of a tick, before the first of them cuts."""
        num_columns = sum([max_columns_touched(*sweep.pairs, self._raster) for sweep in sweeps])
        if self._refined.reserve(num_columns):
            self._raster = self._box_raster()

    def excavate(self, sweep: CutSweep) -> RemovedSoil:
        """Cut the sweep of one tool in a tick.

        Call `reserve` before the first tool of the tick, and `end_tick` after the last.

        Returns:
            The soil that the tool takes in, a record for each column.
        """
        pairs, refined = sweep.pairs, self._refined
        removed: RemovedSoil
        refined.count, removed = _cut_sweep(
            *pairs, self._raster, self._columns.boxed_arrays, refined.tick, refined.count
        )
        return self._take_in(removed, sweep)

    def excavate_with_rock(
        self, sweep: CutSweep, work: float, strength: NDArray[np.void]
    ) -> RemovedSoil:
        """Cut like `excavate` in terrain that has rock, which yields to work only.

        Args:
            sweep: sweep of the tool.
            work: work of the resistance to cutting in the tick [J].
            strength: `strength_table` of the kinds of soil.
        """
        refined = self._refined
        refined.count = cut_sweep_in_rock(
            *sweep.pairs,
            work,
            self._raster,
            refined.tick,
            refined.count,
            self._columns.boxed_arrays,
            strength,
        )
        return self._take_in(self._remove_lost(), sweep)

    def _remove_lost(self) -> RemovedSoil:
        """Remove from the columns what their subcolumns lost in a sweep."""
        removed: RemovedSoil = _remove_from_columns(
            self._columns.boxed_arrays, self._refined.boxed_arrays, self._refined.count
        )
        return removed

    def _take_in(self, removed: RemovedSoil, sweep: CutSweep) -> RemovedSoil:
        """Return what the tool has room for of the soil it removed; displace the rest."""
        pairs, room = sweep.pairs, sweep.room_mm3
        if room == UNLIMITED_ROOM or removed.size == 0:
            return removed
        if np.abs(pairs.points[:, 1] - pairs.points[:, 0]).max() < _MIN_DISPLACEMENT:
            room = 0
        if int(removed["volume_mm3"].sum()) <= room:
            return removed
        taken, displaced = split_by_room(removed, room)
        self._displacement.add(displaced, pairs)
        return np.asarray(taken)

    def mill(
        self, sweep: CutSweep, work: float, strength: NDArray[np.void]
    ) -> tuple[RemovedSoil, Milling]:
        """Mill the sweep of one drum in a tick; call it like `excavate`.

        Args:
            sweep: sweep of the drum.
            work: work that it can deliver [J].
            strength: `strength_table` of the kinds of soil.

        Returns:
            (The removed soil, a record for each column; what the drum engaged).
        """
        refined = self._refined
        contacts = np.zeros((2, 2, 3))
        refined.count, used = mill_sweep(
            *sweep.pairs,
            work,
            self._raster,
            refined.tick,
            refined.count,
            self._columns.boxed_arrays,
            strength,
            contacts,
        )
        return self._remove_lost(), Milling(sweep.machine_id, sweep.tool, used, contacts)

    def _box_raster(self) -> BoxedTable:
        """Return the arrays that sweeps are rasterized to, until they are allocated again."""
        columns = self._columns.arrays
        boxed: BoxedTable = box_table(
            RasterTables(columns.height, columns.floor, *self._refined.arrays, self._grid)
        )
        return boxed

    def end_tick(self) -> tuple[ColumnShares | None, NDArray[np.int64]]:
        """End the tick: occupy the columns that a tool was in, and level and free the others.

        Returns:
            (displaced soil that columns get, None without any; flat indices of the columns that the
            tools have left, sorted).
        """
        refined, freed = self._refined.end_tick()
        if refined.size or freed.size:  # not all tools are in the air
            occupied = self.occupied.reshape(-1)
            occupied[freed] = FREE
            occupied[refined] = TOOL_INSIDE
        return self._displacement.end_tick(), freed


@fixed_signature_kernel
def _cut_sweep(points, has_plate, boxed_raster, boxed_columns, tick, count):  # type: ignore[no-untyped-def]
    """Rasterize the sweep of a tool, and remove what the subcolumns lose from the columns.

    Args:
        points, has_plate: fields of its `SweptPairs`.
        boxed_raster, boxed_columns: `RasterTables` and `ColumnArrays`, boxed; changed.
        tick: number of the tick.
        count: number of refined columns.

    Returns:
        (Number of refined columns, `REMOVED_SOIL` records).
    """
    raster = raster_in_tick(boxed_raster.table, tick)
    count = rasterize_sweep(points, has_plate, raster, count)
    return count, _remove(boxed_columns.table, raster, count)


@kernel
def _remove_from_columns(boxed_columns, boxed_refined, num_refined):  # type: ignore[no-untyped-def]
    """Remove what the subcolumns lost from the columns, as whole mm^3 of bank volume.

    Args:
        boxed_columns, boxed_refined: `ColumnArrays` and `RefinedArrays`, boxed.
        num_refined: number of refined columns.

    Returns:
        `REMOVED_SOIL` records.
    """
    return _remove(boxed_columns.table, boxed_refined.table, num_refined)


@helper(allocates=True)
def _remove(columns, refined, num_refined):  # type: ignore[no-untyped-def]
    """Remove soil as `_remove_from_columns`; `refined` has the fields of `RefinedArrays`."""
    removed = np.empty(num_refined, REMOVED_SOIL)
    return removed[: _fill_removed(columns, refined, removed)]


@helper
def _fill_removed(columns, refined, removed):  # type: ignore[no-untyped-def]
    """Remove soil as `_remove`, without counts of references; return the number of records."""
    moments, subcolumn_height = refined.removed_moments, refined.subcolumn_height
    cells, mean_height = refined.cells, refined.mean_height
    num_subcolumns = subcolumn_height.shape[1]
    count = 0
    for slot in range(removed.size):
        height_sum = moments[slot, REMOVED_HEIGHT]
        if height_sum <= 0.0:
            continue
        i = cells[slot]
        bulk = height_sum / num_subcolumns / columns.metres_per_mm3
        loose, firm = remove_from_column(columns, i, bulk)
        # The rounding error is spread evenly: the mean of the subcolumns stays the height.
        rounding = columns.height[i] - (mean_height[slot] - height_sum / num_subcolumns)
        for q in range(num_subcolumns):
            subcolumn_height[slot, q] += rounding
        mean_height[slot] = columns.height[i]
        if loose + firm == 0:
            continue
        record = removed[count]
        record.cell, record.volume_mm3 = i, loose + firm
        record.x = moments[slot, MOMENT_X] / height_sum
        record.y = moments[slot, MOMENT_Y] / height_sum
        record.z = moments[slot, MOMENT_Z] / height_sum
        # Removing soil changes neither the kinds nor the moistures of a column.
        record.soil = columns.soil[i] if firm > loose else columns.loose_soil[i]
        record.moisture = mix_moisture(loose, columns.loose_moisture[i], firm, columns.moisture[i])
        count += 1
    return count
