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
from msg_bridge.contract.rows import CONVERSION, LANDED, SWEEP, Rows, join_rows
from soil_sim.answers import answers_to, changed_rows, excavated_rows
from soil_sim.changes import Changes
from soil_sim.columns import Columns
from soil_sim.cut import SweptCut
from soil_sim.errors import SoilError
from soil_sim.force.resistance import Resistance, no_resistance
from soil_sim.keypoints import KeyPointCut
from soil_sim.landing import landing_shares
from soil_sim.params import SoilParams
from soil_sim.press import press
from soil_sim.slip import Slip
from soil_sim.slip.noise import slip_noise
from soil_sim.soils import soil_tables
from soil_sim.sweeps import Sweeps, sound_sweeps, strokes_of
from soil_sim.tiles import Tiles

__all__ = ["Soil", "SoilStep"]


@dataclass(frozen=True)
class SoilStep:
    """What one tick moved; rows are not numbered yet (`seq` 0).

    Attributes:
        conversions: CONVERSION rows, answers to landed rows in the order they came.
        forces: FORCE rows, one per tool that swept; none for a refused one.
        changed: CHANGED rows, one per column that is not as it was.
        refused: a sentence for each tool whose rows were left out: which, why, what to change.
    """

    conversions: Rows
    forces: Rows
    changed: Rows
    refused: tuple[str, ...]


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
                `params.other_soils`; all 0 if not given.
            moisture: of each column [%], shape (rows, cols); if not given, that of its soil.

        Raises:
            ParameterError, SoilError, ConfigError: soils or layers that cannot be.
        """
        self.params = params or SoilParams()
        self.kinds = self.params.kinds()
        self.columns = Columns(
            grid,
            heights,
            dig_depth=self.params.dig_depth,
            tables=soil_tables(self.kinds),
            soil=soil,
            moisture=moisture,
        )
        if moisture is None:
            found = [kind.moisture for kind in self.loose_soils]
            self.columns.moisture[:] = np.array(found, dtype=np.uint8)[self.columns.soil]
        self.slip = Slip(
            self.columns,
            radius=self.params.slip_radius,
            tolerance=self.params.slip_tolerance,
            noise=slip_noise(self.params, grid, self.kinds[0].angle(self.kinds[0].moisture)),
        )
        self._swept = SweptCut(self.columns, self.slip.held, resolution=self.params.cut_resolution)
        self._key_points = KeyPointCut(self.columns, between=self.params.key_points_between)
        self._resistance = Resistance(self.columns, self.kinds)
        self._changes = Changes(self.columns)
        self._tiles = Tiles(self.columns)
        self.revision = 0

    @property
    def grid(self) -> Grid:
        """Where each column stands."""
        return self.columns.grid

    @property
    def loose_soils(self) -> tuple[LooseSoil, ...]:
        """What a machine must know of the kinds of soil, by id."""
        soils = (kind.loose for kind in self.kinds)
        if self.params.moisture < 0:
            return tuple(soils)
        return tuple(replace(soil, moisture=self.params.moisture) for soil in soils)

    @property
    def total_mm3(self) -> int:
        """Bank volume of the terrain [mm^3]."""
        return self._tiles.total_mm3

    @property
    def layers(self) -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]:
        """Bank volume of each column [mm^3], id and moisture [%] of the soil at its surface."""
        columns = self.columns
        return columns.firm + columns.loose, columns.top_soil, columns.top_moisture

    def verify(self) -> bool:
        """Count every column anew and compare with the running count."""
        return self.columns.total_mm3 == self.total_mm3

    def state_hash(self) -> str:
        """SHA-256 [hex] of the firm and loose volumes of all columns; see `soil_sim.tiles`."""
        return self._tiles.state_hash()

    def step(self, tick: int, sweeps: Rows, landed: Rows) -> SoilStep:
        """Advance one tick.

        Args:
            tick: number of the tick, written into the conversions.
            sweeps: SWEEP rows of all sources, in the order of source and seq.
            landed: LANDED rows likewise.

        Raises:
            SoilError: not rows, or not the number of a tick; nothing was changed.
        """
        if sweeps.dtype != SWEEP or landed.dtype != LANDED or not 0 <= tick < 2**32:
            raise SoilError(
                f"tick {tick} needs SWEEP and LANDED rows and a number in 32 bits; got rows with "
                f"{sweeps.dtype.names} and {landed.dtype.names}"
            )
        sound, refused = sound_sweeps(sweeps)
        answers = answers_to(landed, tick, self.grid, len(self.kinds))
        forces = self._resist(sound)
        excavated = self._cut(tick, sound)
        poured = self._deposit(answers)
        self.slip.relax(max(self.params.slip_budget - poured, 0))
        conversions = join_rows([excavated, answers], CONVERSION)
        return SoilStep(conversions, forces, self._changed(), refused)

    def _resist(self, sweeps: Sweeps) -> Rows:
        """What tools that begin to cut feel, by the soil as it stands."""
        if self.params.force_mode == "reference":
            return no_resistance(sweeps)
        return self._resistance.wrenches(sweeps)

    def _cut(self, tick: int, sweeps: Sweeps) -> Rows:
        strokes = strokes_of(sweeps)
        swept = self.params.cut_mode == "swept"
        if swept:
            self._swept.reserve(stroke.cut for stroke in strokes)
        parts = []
        for stroke in strokes:
            if swept:
                removed = self._swept.sweep(stroke.cut)
            else:
                removed = self._key_points.sweep(stroke.rows)
                self.slip.disturb(removed[:, 0].astype(np.int64), around=True)
            parts.append(excavated_rows(removed, tick, stroke.source, self.grid))
            if swept:
                self.slip.disturb(press(self.columns, stroke.press), around=True)
        self.slip.disturb(self._swept.release(), around=True)
        return join_rows(parts, CONVERSION)

    def _deposit(self, answers: Rows) -> int:
        """Let soil land and run down; returns what that took of the budget."""
        if answers.size == 0:
            return 0
        return self.slip.pour(*landing_shares(self.grid, answers), self.params.slip_budget)

    def _changed(self) -> Rows:
        changed = self._changes.take()
        self._tiles.add(changed.touched, changed.grown)
        self.revision += bool(changed.cells.size)
        return changed_rows(changed, self.columns, self.revision)
