"""SplitSoil: a terrain split among regions, with the interface of one `Soil`.

In each tick every region applies what its neighbours sent in the tick before: the columns of its
halo that changed, and the soil that slid over the border. Between the ticks that soil is in flight;
it is part of the volume of the terrain.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.rows import (
    CONVERSION,
    DEPOSIT_REQUEST,
    FORCE,
    MAP_UPDATE,
    Rows,
    SoilReaction,
    empty_rows,
    join_rows,
)
from soil_sim.soil import Soil, SoilStepResult
from soil_sim.soils.params import SoilParams
from soil_sim.split_terrain.border_link import BorderLink, BorderRows, Channel, deliver
from soil_sim.split_terrain.region import RegionStep, SoilRegion
from soil_sim.split_terrain.slabs import split_into_slabs
from soil_sim.split_terrain.tool_shares import share_sweeps
from soil_sim.sweep_validation import validate_sweeps

__all__ = ["SplitSoil"]

_FROM_LOWER, _FROM_HIGHER = 65534, 65535
"""Ids that stand for a neighbour in its deposit requests: larger than those of machines."""


class SplitColumns(NamedTuple):
    """Layers of `Columns` that the exchange and operators read.

    Attributes:
        height: surface [m], shape (rows, cols).
    """

    height: NDArray[np.float64]


class SplitSoil:
    """Several regions of one terrain.

    Attributes:
        params: parameters of the soil.
        grid: positions of the columns of the whole terrain.
        regions: its regions, by row.
        loose_soils: properties of the kinds of soil that machines need, by id.
        revision: number of ticks that changed the terrain.
    """

    def __init__(
        self,
        grid: Grid,
        heights: NDArray[np.floating],
        params: SoilParams | None = None,
        *,
        num_regions: int,
        halo: int = 32,
        soil: NDArray[np.integer] | None = None,
        moisture: NDArray[np.integer] | None = None,
        make_channel: Callable[[], Channel] = lambda: deliver,
    ) -> None:
        """
        Args:
            grid, heights, params, soil, moisture: see `Soil`.
            num_regions: number of regions, slabs of equal numbers of rows.
            halo: width of the halo [rows]; at least the relaxation radius, better the size of a
                tool and the length of the wedges that fail.
            make_channel: returns the channel of each direction of a border.

        Raises:
            ParameterError: regions narrower than the halo.
            SoilError, ConfigError: see `Soil`.
        """
        self.params, self.grid = params or SoilParams(), grid
        whole = Soil(grid, heights, self.params, soil=soil, moisture=moisture)
        self.loose_soils: tuple[LooseSoil, ...] = whole.loose_soils
        self.regions = [
            SoilRegion(
                grid,
                slab,
                heights,
                self.params,
                soil=whole.columns.soil,
                moisture=whole.columns.moisture,
            )
            for slab in split_into_slabs(grid, num_regions, halo)
        ]
        self._slabs = [region.slab for region in self.regions]
        borders = range(num_regions - 1)
        self._up = [BorderLink(_FROM_LOWER, make_channel()) for _ in borders]
        self._down = [BorderLink(_FROM_HIGHER, make_channel()) for _ in borders]
        self._arriving: list[list[BorderRows]] = [[] for _ in self.regions]
        self.revision = 0

    @property
    def in_flight_mm3(self) -> int:
        """Bank volume that slid over a border in the last tick and is in no region [mm^3]."""
        return sum(
            int(rows.transfers["volume_mm3"].sum(dtype=np.int64))
            for arriving in self._arriving
            for rows in arriving
        )

    @property
    def total_mm3(self) -> int:
        """Bank volume of the terrain [mm^3], that in flight included."""
        return sum(region.own_mm3 for region in self.regions) + self.in_flight_mm3

    @property
    def num_pending(self) -> int:
        """Number of columns that wait for relaxation, and of transfers in flight."""
        queued = sum(region.soil.relaxation.num_pending for region in self.regions)
        return queued + sum(rows.transfers.size for each in self._arriving for rows in each)

    @property
    def columns(self) -> SplitColumns:
        """Layers of the whole terrain, copied from its regions."""
        return SplitColumns(self._assemble(lambda soil: soil.columns.height))

    @property
    def layers(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]:
        """Layers of the map, see `Soil.layers`."""
        return (
            self._assemble(lambda soil: soil.columns.firm + soil.columns.loose),
            self._assemble(lambda soil: soil.columns.top_soil),
            self._assemble(lambda soil: soil.columns.top_moisture),
            self._assemble(lambda soil: soil.columns.rut_depth),
        )

    def verify_volume(self) -> bool:
        """Return whether the running volume of each region equals the sum over its columns."""
        return all(region.sum_own_volume() == region.own_mm3 for region in self.regions)

    def state_hash(self) -> str:
        """Return the SHA-256 [hex] of the layers and of the volume in flight."""
        digest = hashlib.sha256(self.in_flight_mm3.to_bytes(8, "little"))
        for layer in (*self.layers, self._assemble(lambda soil: soil.columns.bulk)):
            digest.update(layer.tobytes())
        return digest.hexdigest()

    def step(self, tick: int, sweeps: Rows, deposit_requests: Rows) -> SoilStepResult:
        """Advance one tick.

        Args:
            tick: number of the tick.
            sweeps: SWEEP rows of all machines, in the order of machine and `seq`.
            deposit_requests: DEPOSIT_REQUEST rows of all machines, in the same order.
        """
        valid, rejected_tools = validate_sweeps(np.ascontiguousarray(sweeps))
        shared = share_sweeps(valid, self.grid, self._slabs)
        region_of_request = self._regions_of(deposit_requests)
        arriving, self._arriving = self._arriving, [[] for _ in self.regions]
        steps = []
        for number, region in enumerate(self.regions):
            for rows in arriving[number]:
                region.apply_halo_updates(rows.map_updates)
            transfers = join_rows([rows.transfers for rows in arriving[number]], DEPOSIT_REQUEST)
            requests = deposit_requests[region_of_request == number]
            steps.append(region.step(tick, shared.rows[number], requests, transfers))
        self._exchange(steps)
        conversions = empty_rows(CONVERSION, deposit_requests.size)
        for number, step in enumerate(steps):
            conversions[region_of_request == number] = step.deposits
        excavated = join_rows([step.excavated for step in steps], CONVERSION)
        map_updates = join_rows([step.map_updates for step in steps], MAP_UPDATE)
        if map_updates.size:
            self.revision += 1
            map_updates = map_updates.copy()
            map_updates["revision"] = self.revision
        return SoilStepResult(
            join_rows([excavated, conversions], CONVERSION),
            _merge_forces([step.forces for step in steps], shared.owners),
            map_updates,
            rejected_tools,
        )

    def _regions_of(self, deposit_requests: Rows) -> NDArray[np.int64]:
        """Return the number of the region of each deposit request; 0 for malformed ones."""
        row = np.nan_to_num(self.grid.row(deposit_requests["x"]), nan=0.0, posinf=0.0, neginf=0.0)
        last_rows = [slab.end - 0.5 for slab in self._slabs[:-1]]
        return np.searchsorted(last_rows, row).astype(np.int64)

    def _exchange(self, steps: list[RegionStep]) -> None:
        """Send what a tick changed to the neighbours, for the next tick."""
        for lower, (step, next_step) in enumerate(pairwise(steps)):
            up = BorderRows(step.map_updates, self._transfers_to(step, lower + 1))
            down = BorderRows(next_step.map_updates, self._transfers_to(next_step, lower))
            self._arriving[lower + 1].append(self._up[lower].transmit(up))
            self._arriving[lower].append(self._down[lower].transmit(down))

    def _transfers_to(self, step: RegionStep, number: int) -> Rows:
        """Return the transfers of a region that are for a neighbour, numbered as particles."""
        transfers: Rows = step.transfers[self._regions_of(step.transfers) == number]
        transfers["particle_id"] = np.arange(transfers.size)
        return transfers

    def _assemble(self, layer: Callable[[Soil], NDArray[Any]]) -> NDArray[Any]:
        """Return a layer of the whole terrain from the own columns of all regions."""
        return np.concatenate([region.own_layer(layer(region.soil)) for region in self.regions])


def _merge_forces(forces: list[Rows], owners: dict[tuple[int, int], int]) -> Rows:
    """Return the FORCE rows of each tool that its owner computed.

    A drum's row has the work of all regions.
    """
    parts = []
    mill = int(SoilReaction.MILL)
    work: dict[tuple[int, int], float] = {}
    for number, rows in enumerate(forces):
        tools = list(zip(rows["machine_id"].tolist(), rows["tool"].tolist(), strict=True))
        is_owned = np.array([owners[tool] == number for tool in tools], dtype=np.bool_)
        parts.append(rows[is_owned])
        for tool, reaction, done in zip(
            tools, rows["reaction"].tolist(), rows["work"].tolist(), strict=True
        ):
            if reaction == mill:
                work[tool] = work.get(tool, 0.0) + done
    merged = join_rows(parts, FORCE).copy()
    for row in merged[merged["reaction"] == mill] if work else ():
        row["work"] = work[int(row["machine_id"]), int(row["tool"])]
    return merged
