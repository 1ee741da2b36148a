"""The soil of one region: its own columns, and a halo of columns of its neighbours.

A column of the halo is hollow: it has a height and no soil. Tools find nothing to remove in it and
nothing slides from it, so that a region moves its own soil only; but soil may slide onto it. After
the tick that soil is taken away again, and goes to the neighbour as a deposit request.

A hollow column has negative `packing`: of the volumes that its height is computed from, that is the
one which is not soil.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import (
    DEPOSIT_REQUEST,
    ConversionKind,
    Rows,
    join_rows,
)
from soil_sim.endpoint import split_into_deposit_requests
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.split_terrain.halo_soil import RegionParams
from soil_sim.split_terrain.slabs import Slab

__all__ = ["RegionStep", "SoilRegion"]


class RegionStep(NamedTuple):
    """Result of a tick of a region; rows are of the whole grid, in the map frame.

    Attributes:
        excavated: CONVERSION rows of the excavated soil.
        deposits: CONVERSION rows, one for each deposit request of a machine, in their order.
        forces: FORCE rows of all tools that were given.
        map_updates: MAP_UPDATE rows of its own columns.
        transfers: DEPOSIT_REQUEST rows of the soil that slid onto the halo.
    """

    excavated: Rows
    deposits: Rows
    forces: Rows
    map_updates: Rows
    transfers: Rows


class SoilRegion:
    """One region.

    Attributes:
        slab: the rows of the whole grid that it owns and holds.
        soil: the soil of the rows that it holds.
    """

    def __init__(
        self,
        grid: Grid,
        slab: Slab,
        heights: NDArray[np.floating],
        params: SoilParams,
        *,
        soil: NDArray[np.integer],
        moisture: NDArray[np.integer],
    ) -> None:
        """
        Args:
            grid: the whole grid.
            slab: rows of the region.
            heights: surface of the undisturbed soil [m], shape (rows, cols) of the whole grid.
            params: parameters of the whole terrain.
            soil: kind of each column by id, same shape.
            moisture: moisture of each column [%], same shape.
        """
        self.slab = slab
        self._whole, held = grid, slice(slab.low, slab.high)
        self._num_kinds = len(params.soil_types())
        self._x_offset = float(grid.x(0.5 * (slab.low + slab.high - 1)))
        self._own = slice(slab.first - slab.low, slab.end - slab.low)
        is_halo = np.ones(slab.high - slab.low, dtype=np.bool_)
        is_halo[self._own] = False
        self._halo_rows = np.flatnonzero(is_halo)
        depth = float(heights[held].min() - heights.min()) + params.soil_depth
        self.soil = Soil(
            Grid(slab.high - slab.low, grid.cols, grid.cell),
            heights[held],
            RegionParams.of(params, depth),
            soil=soil[held] + self._num_kinds * is_halo[:, None],
            moisture=moisture[held],
        )
        columns = self.soil.columns
        self._volume = columns.firm + columns.loose  # of each column at the end of the last tick
        self._hollow = columns.firm.copy()  # height of the columns of the halo [mm^3]
        self._volume[self._halo_rows] = 0
        columns.firm[self._halo_rows] = 0
        self._restore_halo()
        self.own_mm3 = int(self._volume.sum())

    def apply_halo_updates(self, updates: Rows) -> None:
        """Change the columns of the halo.

        Args:
            updates: MAP_UPDATE rows of columns of neighbours, the latest of a column last.
        """
        slab, columns = self.slab, self.soil.columns
        rows = updates["row"].astype(np.int64)
        updates = updates[(rows >= slab.low) & (rows < slab.high)]
        if updates.size == 0:
            return
        rows, cols = updates["row"].astype(np.int64) - slab.low, updates["col"].astype(np.int64)
        height = updates["z"].astype(np.float64) - columns.floor
        self._hollow[rows, cols] = np.rint(height / columns.metres_per_mm3).astype(np.int64)
        columns.soil[rows, cols] = updates["soil"] + self._num_kinds
        columns.moisture[rows, cols] = updates["moisture"]
        self._restore_halo()
        cells = rows * self._whole.cols + cols
        self.soil.relaxation.mark_disturbed(cells, include_neighbours=True)

    def step(self, tick: int, sweeps: Rows, deposit_requests: Rows, transfers: Rows) -> RegionStep:
        """Advance one tick.

        Args:
            tick: number of the tick.
            sweeps: SWEEP rows of the tools that are in the region or its halo.
            deposit_requests: DEPOSIT_REQUEST rows of machines, of columns that it owns.
            transfers: DEPOSIT_REQUEST rows of soil that slid here from neighbours.
        """
        step = self.soil.step(
            tick,
            self._to_region(sweeps, "x0", "x1"),
            self._to_region(join_rows([deposit_requests, transfers], DEPOSIT_REQUEST), "x"),
        )
        conversions = self._to_map(step.conversions)
        has_column = (conversions["kind"] == ConversionKind.EXCAVATE) | (
            conversions["kind"] == ConversionKind.DEPOSIT
        )
        conversions["row"] += (self.slab.low * has_column).astype(np.uint32)
        num_excavated = conversions.size - deposit_requests.size - transfers.size
        answers = conversions[num_excavated : num_excavated + deposit_requests.size]
        answers["x"] = deposit_requests["x"]  # exactly
        map_updates = self._own_updates(step.map_updates)
        return RegionStep(
            conversions[:num_excavated],
            answers,
            self._to_map(step.forces),
            map_updates,
            self._collect_transfers(),
        )

    def sum_own_volume(self) -> int:
        """Return the bank volume of its own columns, summed over them [mm^3]."""
        firm, loose = (
            layer[self._own] for layer in (self.soil.columns.firm, self.soil.columns.loose)
        )
        return int(firm.sum()) + int(loose.sum())

    def own_layer(self, layer: NDArray[Any]) -> NDArray[Any]:
        """Return the part of a layer of `soil.columns` that belongs to its own columns."""
        return layer[self._own]

    def _own_updates(self, updates: Rows) -> Rows:
        """Return the MAP_UPDATE rows of its own columns, and add up their volume."""
        rows = updates["row"].astype(np.int64)
        own = self._to_map(updates[(rows >= self._own.start) & (rows < self._own.stop)])
        own["row"] += np.uint32(self.slab.low)
        where = own["row"].astype(np.int64) - self.slab.low, own["col"].astype(np.int64)
        volume = own["volume_mm3"].astype(np.int64)
        self.own_mm3 += int((volume - self._volume[where]).sum())
        self._volume[where] = volume
        return own

    def _collect_transfers(self) -> Rows:
        """Return the soil that slid onto the halo as DEPOSIT_REQUEST rows, and take it away."""
        columns, halo = self.soil.columns, self._halo_rows
        i, j = np.nonzero(columns.loose[halo])
        parts = []
        for row, col in zip(halo[i].tolist(), j.tolist(), strict=True):
            part = split_into_deposit_requests(int(columns.loose[row, col]))
            part["x"], part["y"] = self._whole.x(row + self.slab.low), self._whole.y(col)
            part["z"] = columns.height[row, col]
            part["soil"] = columns.loose_soil[row, col]
            part["moisture"] = columns.loose_moisture[row, col]
            parts.append(part)
        self._restore_halo()
        return join_rows(parts, DEPOSIT_REQUEST)

    def _restore_halo(self) -> None:
        """Make the columns of the halo hollow, with the heights that their owners reported."""
        columns, halo = self.soil.columns, self._halo_rows
        is_changed = (columns.packing[halo] != -self._hollow[halo]) | (columns.loose[halo] != 0)
        i, j = np.nonzero(is_changed)
        where = halo[i], j
        for layer in (columns.firm, columns.loose, columns.bulk, columns.rut_volume):
            layer[where] = 0
        columns.packing[where] = -self._hollow[where]
        columns.height[where] = columns.floor + self._hollow[where] * columns.metres_per_mm3

    def _to_region(self, rows: Rows, *fields: str) -> Rows:
        """Return rows with x relative to the middle of the region."""
        moved = rows.copy()
        for field in fields:
            moved[field] -= self._x_offset
        return moved

    def _to_map(self, rows: Rows) -> Rows:
        """Return rows of the region with x in the map frame."""
        moved = rows.copy()
        moved["x"] += self._x_offset
        return moved
