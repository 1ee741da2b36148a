"""The soil: one tick turns what tools swept and what landed into what was actually moved.

    judge -> resist -> cut, press -> deposit -> slip

All input is judged before the first column changes, so a tick is done whole or not at all: a tool
whose rows cannot be believed is refused, a landed row likewise, and what is left cannot fail.

This is the whole of the soil side's physics; it knows no messages, no clock and no accounts but
the terrain's own. The exchange (`msg_bridge.exchange`) numbers the rows it returns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.rows import CONVERSION, DEPOSIT_REQUEST, SWEEP, Rows, join_rows
from soil_sim.columns.changes import ChangeTracker
from soil_sim.columns.state import Columns
from soil_sim.columns.tile_checksum import TileChecksums
from soil_sim.compaction import compact
from soil_sim.deposition import bilinear_shares
from soil_sim.errors import SoilError
from soil_sim.excavation.keypoint_cut import KeyPointCut
from soil_sim.excavation.swept_cut import SweptCut
from soil_sim.row_output import convert_deposit_requests, excavation_rows, map_update_rows
from soil_sim.slope_failure import SlopeRelaxation
from soil_sim.slope_failure.noise import relaxation_noise
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import build_soil_tables
from soil_sim.tool_force.tool_forces import ToolForces, zero_tool_forces
from soil_sim.tool_sweeps import ValidSweeps, group_by_machine, validate_sweeps

__all__ = ["Soil", "SoilStepResult"]


@dataclass(frozen=True)
class SoilStepResult:
    """What one tick moved; rows are not numbered yet (`seq` 0).

    Attributes:
        conversions: CONVERSION rows, answers to landed rows in the order they came.
        forces: FORCE rows, one per tool that swept; none for a refused one.
        changed: CHANGED rows, one per column that is not as it was.
        refused: a sentence for each tool whose rows were left out: which, why, what to change.
    """

    conversions: Rows
    forces: Rows
    map_updates: Rows
    rejected_tools: tuple[str, ...]


class Soil:
    """A terrain that is cut, filled and slips.

    Attributes:
        params: as given.
        kinds: the kinds of soil in it, by id.
        columns: the terrain's state.
        slip: columns waiting to slip.
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
            grid: where each column stands.
            heights: surface of the undisturbed soil [m], shape (rows, cols).
            params: defaults to the reference's soil.
            soil: kind of each column, shape (rows, cols): 0 the ground's own, 1 and on those of
                `params.additional_soils`; all 0 if not given.
            moisture: of each column [%], shape (rows, cols); if not given, that of its soil.

        Raises:
            ParameterError, SoilError, ConfigError: soils or layers that cannot be.
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
            found = [kind.moisture for kind in self.loose_soils]
            self.columns.moisture[:] = np.array(found, dtype=np.uint8)[self.columns.soil]
        self.relaxation = SlopeRelaxation(
            self.columns,
            radius=self.params.relaxation_radius,
            tolerance=self.params.relaxation_tolerance,
            noise=relaxation_noise(
                self.params, grid, self.soil_types[0].repose_angle_at(self.soil_types[0].moisture)
            ),
        )
        self._swept_cut = SweptCut(
            self.columns, self.relaxation.occupied, resolution=self.params.cut_resolution
        )
        self._keypoint_cut = KeyPointCut(
            self.columns, num_interpolated=self.params.num_interpolated_key_points
        )
        self._tool_forces = ToolForces(self.columns, self.soil_types)
        self._changes = ChangeTracker(self.columns)
        self._tile_checksums = TileChecksums(self.columns)
        self.revision = 0

    @property
    def grid(self) -> Grid:
        """Where each column stands."""
        return self.columns.grid

    @property
    def loose_soils(self) -> tuple[LooseSoil, ...]:
        """What a machine must know of the kinds of soil, by id."""
        soils = (kind.loose_soil for kind in self.soil_types)
        if self.params.moisture < 0:
            return tuple(soils)
        return tuple(replace(soil, moisture=self.params.moisture) for soil in soils)

    @property
    def total_mm3(self) -> int:
        """Bank volume of the terrain [mm^3]."""
        return self._tile_checksums.total_mm3

    @property
    def layers(self) -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]:
        """Bank volume of each column [mm^3], id and moisture [%] of the soil at its surface."""
        columns = self.columns
        return columns.firm + columns.loose, columns.top_soil, columns.top_moisture

    def verify_volume(self) -> bool:
        """Count every column anew and compare with the running count."""
        return self.columns.total_mm3 == self.total_mm3

    def state_hash(self) -> str:
        """SHA-256 [hex] of the firm and loose volumes of all columns; see `soil_sim.columns.tile_checksum`."""
        return self._tile_checksums.state_hash()

    def step(self, tick: int, sweeps: Rows, deposit_requests: Rows) -> SoilStepResult:
        """Advance one tick.

        Args:
            tick: number of the tick, written into the conversions.
            sweeps: SWEEP rows of all sources, in the order of source and seq.
            landed: LANDED rows likewise.

        Raises:
            SoilError: not rows, or not the number of a tick; nothing was changed.
        """
        if (
            sweeps.dtype != SWEEP
            or deposit_requests.dtype != DEPOSIT_REQUEST
            or not 0 <= tick < 2**32
        ):
            raise SoilError(
                f"tick {tick} needs SWEEP and LANDED rows and a number in 32 bits; got rows with "
                f"{sweeps.dtype.names} and {deposit_requests.dtype.names}"
            )
        sound, rejected_tools = validate_sweeps(sweeps)
        answers = convert_deposit_requests(deposit_requests, tick, self.grid, len(self.soil_types))
        forces = self._compute_tool_forces(sound)
        excavated = self._excavate(tick, sound)
        poured = self._deposit(answers)
        self.relaxation.relax(max(self.params.max_cell_visits_per_tick - poured, 0))
        conversions = join_rows([excavated, answers], CONVERSION)
        return SoilStepResult(conversions, forces, self._collect_map_updates(), rejected_tools)

    def _compute_tool_forces(self, sweeps: ValidSweeps) -> Rows:
        """What tools that begin to cut feel, by the soil as it stands."""
        if self.params.force_mode == "reference":
            return zero_tool_forces(sweeps)
        return self._tool_forces.compute(sweeps)

    def _excavate(self, tick: int, sweeps: ValidSweeps) -> Rows:
        strokes = group_by_machine(sweeps)
        swept = self.params.cut_mode == "swept"
        if swept:
            self._swept_cut.reserve(stroke.cut_pairs for stroke in strokes)
        parts = []
        for stroke in strokes:
            if swept:
                removed = self._swept_cut.excavate(stroke.cut_pairs)
            else:
                removed = self._keypoint_cut.excavate(stroke.rows)
                self.relaxation.mark_disturbed(
                    removed[:, 0].astype(np.int64), include_neighbours=True
                )
            parts.append(excavation_rows(removed, tick, stroke.machine_id, self.grid))
            if swept:
                self.relaxation.mark_disturbed(
                    compact(self.columns, stroke.press_pairs), include_neighbours=True
                )
        self.relaxation.mark_disturbed(self._swept_cut.end_tick(), include_neighbours=True)
        return join_rows(parts, CONVERSION)

    def _deposit(self, answers: Rows) -> int:
        """Let soil land and run down; returns what that took of the budget."""
        if answers.size == 0:
            return 0
        return self.relaxation.deposit_with_runout(
            *bilinear_shares(self.grid, answers), self.params.max_cell_visits_per_tick
        )

    def _collect_map_updates(self) -> Rows:
        changed = self._changes.collect()
        self._tile_checksums.apply_changes(changed.touched, changed.volume_change_mm3)
        self.revision += bool(changed.cells.size)
        return map_update_rows(changed, self.columns, self.revision)
