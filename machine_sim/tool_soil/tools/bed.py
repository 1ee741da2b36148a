"""A bed: carries soil, and neither cuts nor compacts it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine import Tool
from machine_sim.machine.tools.bed import BedShape
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.payload import Payload, measure_payload
from machine_sim.tool_soil.tools.interaction import (
    NoPendingSoil,
    NoResistance,
    ToolMotion,
    Twist,
)
from msg_bridge.contract.rows import SWEEP, Rows, empty_rows

__all__ = ["BedInteraction"]


class BedInteraction:
    """How a bed acts on soil; see `ToolInteraction`."""

    is_digging = False
    is_milling = False
    key_points: NDArray[np.float64] = np.zeros((0, 3))

    def __init__(self, shape: BedShape, tool_id: int) -> None:
        """
        Args:
            shape: shape of the bed.
            tool_id: id of the tool; a bed has no rows.
        """
        self._shape = shape

    def sweep(self, motion: ToolMotion) -> Rows:
        """Return no SWEEP rows."""
        return empty_rows(SWEEP)

    def make_pending(
        self, rng: np.random.Generator, *, nominal_mm3: int, max_per_tick: int
    ) -> NoPendingSoil:
        """Return an account that stays empty."""
        return NoPendingSoil()

    def make_resistance(
        self, tool: Tool, machine_mass: float, params: MachineSimParams
    ) -> NoResistance:
        """Return no resistance."""
        return NoResistance()

    def release_twist(self, tool: Tool) -> Twist | None:
        """Return None: a bed releases no particles."""
        return None

    def measure(self, particles: SoilEngine, pose: Pose) -> tuple[Payload, float]:
        """Measure the soil in the bed; it takes none from the ground."""
        return measure_payload(self._shape, particles, pose), 0.0
