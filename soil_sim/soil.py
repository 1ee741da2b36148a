"""The soil: one tick turns sweeps and deposit requests into the soil that was actually moved.

    validate -> tool forces -> excavate and compact -> deposit and displace -> relax slopes

All input is validated before the first column changes, so a tick is done completely or not at all:
tools and deposit requests with invalid rows are rejected, and what remains cannot fail.

This is all of the physics of the soil. It has no messages, no clock, and no account of volume other
than that of the terrain. The exchange (`msg_bridge.exchange`) numbers the rows it returns.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.rows import CONVERSION, DEPOSIT_REQUEST, SWEEP, Rows, join_rows
from soil_sim.columns import ChangeTracker, Columns, TileChecksums
from soil_sim.compaction import compact, sinkage_table
from soil_sim.deposition import deposit
from soil_sim.errors import SoilError
from soil_sim.excavation import KeyPointCut, Milling, RemovedSoil, SweptCut
from soil_sim.row_output import convert_deposit_requests, excavation_rows, map_update_rows
from soil_sim.slope_failure import ColumnShares, SlopeRelaxation, relaxation_noise
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import build_soil_tables
from soil_sim.sweep_validation import validate_sweeps
from soil_sim.tool_force.tool_forces import (
    ToolForces,
    cutting_work,
    set_milling_forces,
    zero_tool_forces,
)
from soil_sim.tool_sweeps import CutSweep, MachineSweeps, ValidSweeps, group_by_machine
from soil_sim.track_occupancy import TrackOccupancy

__all__ = ["Soil", "SoilStepResult"]


_ToolWork = dict[tuple[int, int], float]
"""Work of tools [J], by ids of machine and tool."""


class SoilStepResult(NamedTuple):
    """Result of one tick; rows are not numbered yet (`seq` 0).

    Attributes:
        conversions: CONVERSION rows: excavated soil, then the results of the deposit requests in
            the order of the requests.
        forces: FORCE rows, one for each valid tool.
        map_updates: MAP_UPDATE rows, one for each changed column.
        rejected_tools: a message for each rejected tool: which one, why, and what to change.
    """

    conversions: Rows
    forces: Rows
    map_updates: Rows
    rejected_tools: tuple[str, ...]


class Soil:
    """A terrain that is cut and filled, and whose slopes fail.

    Attributes:
        params: parameters of the soil.
        soil_types: kinds of soil, by id.
        columns: state of the terrain.
        relaxation: slopes to relax.
        revision: number of ticks that changed the terrain.
    """

    def __init__(
        self,
        grid: Grid,
        heights: NDArray[np.floating],
        params: SoilParams | None = None,
        *,
        soil: NDArray[np.integer] | None = None,
        moisture: NDArray[np.integer] | None = None,
    ) -> None:
        """
        Args:
            grid: positions of the columns.
            heights: surface of the undisturbed soil [m], shape (rows, cols).
            params: parameters; those of the reference if not given.
            soil: kind of each column by id, shape (rows, cols): 0 is `params.soil`, 1 and up are
                `params.additional_soils`; 0 everywhere if not given.
            moisture: moisture of each column [%], shape (rows, cols); that of its kind of soil if
                not given.

        Raises:
            ParameterError, SoilError, ConfigError: invalid soils or layers.
        """
        self.params = params or SoilParams()
        self.soil_types = self.params.soil_types()
        self.columns = Columns(
            grid,
            heights,
            soil_depth=self.params.soil_depth,
            tables=build_soil_tables(self.soil_types),
            soil=soil,
            moisture=moisture,
        )
        if moisture is None:
            moistures = [kind.moisture for kind in self.loose_soils]
            self.columns.moisture[:] = np.array(moistures, dtype=np.uint8)[self.columns.soil]
        self.relaxation = SlopeRelaxation(
            self.columns,
            radius=self.params.relaxation_radius,
            tolerance=self.params.relaxation_tolerance,
            noise=relaxation_noise(
                self.params, grid, self.soil_types[0].repose_angle_at(self.soil_types[0].moisture)
            ),
        )
        self._swept_cut = SweptCut(
            self.columns,
            self.relaxation.occupied,
            resolution=self.params.cut_resolution,
        )
        self._keypoint_cut = KeyPointCut(
            self.columns, num_interpolated=self.params.num_interpolated_key_points
        )
        self._tool_forces = ToolForces(self.columns, self.soil_types)
        self._has_rock = bool((self._tool_forces.strength["tensile_strength"] > 0.0).any())
        self._sinkage = sinkage_table(self.soil_types)
        self._track_occupancy = TrackOccupancy(self.relaxation.occupied)
        self._changes = ChangeTracker(self.columns)
        self._tile_checksums = TileChecksums(self.columns)
        self.revision = 0

    def continue_from(self, other: Soil) -> None:
        """Take the terrain of a soil that was made for the same site with other parameters.

        Soil in place keeps its bank volume and its density. Where a kind of soil has another
        moisture of its own, that of the soil in place changes by the same difference. All slopes
        are checked, and fail in the next ticks where they are too steep now.

        Raises:
            SoilError: the soil has other columns, or another number of kinds.
        """
        columns, before = self.columns, other.columns
        kinds, kinds_before = len(self.soil_types), len(other.soil_types)
        if kinds != kinds_before:
            raise SoilError(
                f"the terrain is of {kinds_before} kinds of soil, and {kinds} are given; change"
                " the soils, but not their number"
            )
        if columns.grid != before.grid or columns.floor != before.floor:
            raise SoilError(
                f"the terrain has the grid {before.grid} and the floor at {before.floor} m; keep"
                " the site and soil.soil_depth"
            )
        now, then = (
            np.array([kind.moisture for kind in soil.loose_soils], dtype=np.int64)
            for soil in (self, other)
        )
        columns.continue_from(before)
        self._changes = ChangeTracker(columns)
        for moisture, soil in (
            (columns.moisture, columns.soil),
            (columns.loose_moisture, columns.loose_soil),
        ):
            moisture[:] = np.clip(moisture + (now - then)[soil], 0, MOISTURE_LEVELS - 1)
        self._tile_checksums = TileChecksums(columns)
        self.revision = other.revision
        self.relaxation.mark_all_disturbed()

    @property
    def grid(self) -> Grid:
        """Positions of the columns."""
        return self.columns.grid

    @property
    def loose_soils(self) -> tuple[LooseSoil, ...]:
        """Properties of the kinds of soil that machines need, by id."""
        soils = (kind.loose_soil for kind in self.soil_types)
        if self.params.moisture < 0:
            return tuple(soils)
        return tuple(replace(soil, moisture=self.params.moisture) for soil in soils)

    @property
    def total_mm3(self) -> int:
        """Bank volume of the terrain [mm^3]."""
        return self._tile_checksums.total_mm3

    @property
    def layers(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]:
        """Layers of the map, shape (rows, cols) each.

        Bank volume of each column [mm^3], kind by id and moisture [%] of the soil at its surface,
        and depth by which its surface was pressed down [m].
        """
        columns = self.columns
        volume = columns.firm + columns.loose
        return volume, columns.top_soil, columns.top_moisture, columns.rut_depth

    def verify_volume(self) -> bool:
        """Return whether the running volume equals the sum over all columns."""
        return self.columns.total_mm3 == self.total_mm3

    def state_hash(self) -> str:
        """Return the SHA-256 [hex] of the state of all columns.

        See `soil_sim.columns.tile_checksum`.
        """
        return self._tile_checksums.state_hash()

    def step(self, tick: int, sweeps: Rows, deposit_requests: Rows) -> SoilStepResult:
        """Advance one tick.

        Args:
            tick: number of the tick, written into the conversions.
            sweeps: SWEEP rows of all machines, in the order of machine and `seq`.
            deposit_requests: DEPOSIT_REQUEST rows of all machines, in the same order.

        Raises:
            SoilError: rows of another type, or an invalid tick number; nothing was changed.
        """
        if (
            sweeps.dtype != SWEEP
            or deposit_requests.dtype != DEPOSIT_REQUEST
            or (sweeps.ndim, deposit_requests.ndim) != (1, 1)
            or not 0 <= tick < 2**32
        ):
            raise SoilError(
                f"tick {tick} with rows of {sweeps.dtype.names} and {deposit_requests.dtype.names}:"
                " give a tick number of 32 bits, and 1-D arrays of SWEEP and DEPOSIT_REQUEST rows"
            )
        # Kernels are compiled for contiguous arrays that may be written to.
        if not (sweeps.flags.carray and deposit_requests.flags.carray):
            sweeps, deposit_requests = sweeps.copy(), deposit_requests.copy()
        valid_sweeps, rejected_tools = validate_sweeps(sweeps)
        deposits = convert_deposit_requests(
            deposit_requests, tick, self.columns.frame, len(self.soil_types)
        )
        forces = self._compute_tool_forces(valid_sweeps)
        work = self._cutting_work(forces, valid_sweeps)
        excavated, displaced, millings = self._excavate(tick, valid_sweeps, work)
        if self.params.force_mode != "none":
            forces = set_milling_forces(forces, millings)
        num_visits = deposit(
            self.relaxation,
            self.columns.frame,
            deposits,
            displaced,
            self.params.max_cell_visits_per_tick,
        )
        self.relaxation.relax(max(self.params.max_cell_visits_per_tick - num_visits, 0))
        conversions = join_rows([excavated, deposits], CONVERSION)
        return SoilStepResult(conversions, forces, self._collect_map_updates(), rejected_tools)

    def _compute_tool_forces(self, sweeps: ValidSweeps) -> Rows:
        """Return the FORCE rows of all tools, for the soil before this tick's excavation."""
        if self.params.force_mode == "none":
            return zero_tool_forces(sweeps)
        return self._tool_forces.compute(sweeps)

    def _cutting_work(self, forces: Rows, sweeps: ValidSweeps) -> _ToolWork:
        """Return `cutting_work`, empty where nothing is limited by it: without rock or forces."""
        if not self._has_rock or self.params.force_mode == "none":
            return {}
        return cutting_work(forces, sweeps)

    def _excavate(
        self, tick: int, sweeps: ValidSweeps, work: _ToolWork
    ) -> tuple[Rows, ColumnShares | None, list[Milling]]:
        """Cut, mill and compact with the tools of all machines.

        Args:
            tick: number of the tick.
            sweeps: valid sweeps.
            work: `_cutting_work` of the tick.

        Returns:
            (CONVERSION rows of the excavated soil, soil that the tools push ahead, what each drum
            engaged).
        """
        machines = group_by_machine(sweeps)
        millings: list[Milling] = []
        pressed: dict[int, dict[int, NDArray[np.int64]]] = {}
        if self.params.cut_mode == "swept":
            self._swept_cut.reserve([cut for machine in machines for cut in machine.cuts])
            removed = [self._cut(machine, millings, work) for machine in machines]
            pressed = {machine.machine_id: self._compact(machine) for machine in machines}
        else:
            removed = [self._cut_at_key_points(machine) for machine in machines]
        displaced, left = self._swept_cut.end_tick()
        left_by_tracks = self._track_occupancy.end_tick(pressed)
        self.relaxation.mark_disturbed(left, include_neighbours=True)
        self.relaxation.mark_disturbed(left_by_tracks, include_neighbours=True)
        parts = [
            excavation_rows(soil, tick, machine.machine_id, self.grid.cols)
            for machine, soils in zip(machines, removed, strict=True)
            for soil in soils
            if soil.size
        ]
        return join_rows(parts, CONVERSION), displaced, millings

    def _cut(
        self,
        machine: MachineSweeps,
        millings: list[Milling],
        cutting_work: _ToolWork,
    ) -> list[RemovedSoil]:
        """Return the soil that each tool removes; add what drums engage to `millings`."""
        removed = []
        for cut in machine.cuts:
            if cut.work is None:
                removed.append(self._cut_with_plates(cut, cutting_work))
                continue
            work = math.inf if self.params.force_mode == "none" else cut.work  # nothing resists
            milled, milling = self._swept_cut.mill(cut, work, self._tool_forces.strength)
            removed.append(milled)
            millings.append(milling)
        return removed

    def _cut_with_plates(self, cut: CutSweep, cutting_work: _ToolWork) -> RemovedSoil:
        """Return the soil that a tool with plates removes."""
        work = cutting_work.get((cut.machine_id, cut.tool))
        if work is None:
            return self._swept_cut.excavate(cut)
        return self._swept_cut.excavate_with_rock(cut, work, self._tool_forces.strength)

    def _compact(self, machine: MachineSweeps) -> dict[int, NDArray[np.int64]]:
        """Press soil down; return the columns under each track that moved, by tool id."""
        compacted = compact(self.columns, machine, self._sinkage)
        self.relaxation.mark_disturbed(compacted.yielded, include_neighbours=True)
        return compacted.pressed

    def _cut_at_key_points(self, machine: MachineSweeps) -> list[RemovedSoil]:
        removed = self._keypoint_cut.excavate(machine.rows)
        self.relaxation.mark_disturbed(removed["cell"], include_neighbours=True)
        return [removed]

    def _collect_map_updates(self) -> Rows:
        changes = self._changes.collect()
        self._tile_checksums.apply_changes(changes.touched, changes.volume_change_mm3)
        self.revision += bool(changes.cells.size)
        return map_update_rows(changes, self.columns, self.revision)
