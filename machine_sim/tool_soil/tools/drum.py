"""A cutting drum: mills while it is driven, else rests on the ground, and carries nothing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine import Tool
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.milling_resistance import MillingResistance
from machine_sim.tool_soil.payload import EMPTY_PAYLOAD, Payload
from machine_sim.tool_soil.pending_soil import PendingSoil
from machine_sim.tool_soil.sweep import DrumSweep
from machine_sim.tool_soil.tools.interaction import ToolMotion, Twist
from msg_bridge.contract.rows import Rows

__all__ = ["DrumInteraction"]


class DrumInteraction:
    """How a cutting drum acts on soil; see `ToolInteraction`."""

    is_digging = True
    is_milling = True

    def __init__(self, shape: DrumShape, tool_id: int) -> None:
        """
        Args:
            shape: shape of the drum.
            tool_id: id of the tool in rows.
        """
        self._shape = shape
        self._sweep = DrumSweep(shape.key_points, tool_id)

    @property
    def key_points(self) -> NDArray[np.float64]:
        """Tips of the picks [m], drum frame, shape (n, 3)."""
        return self._shape.key_points

    def sweep(self, motion: ToolMotion) -> Rows:
        """Return the SWEEP rows of one tick."""
        return self._sweep.rows(motion.start, motion.end, motion.is_driven, motion.work)

    def make_pending(
        self, rng: np.random.Generator, *, nominal_mm3: int, max_per_tick: int
    ) -> PendingSoil:
        """Return an empty account of excavated soil."""
        return PendingSoil(self._shape, rng, nominal_mm3=nominal_mm3, max_per_tick=max_per_tick)

    def make_resistance(
        self, tool: Tool, machine_mass: float, params: MachineSimParams
    ) -> MillingResistance:
        """Return the torque and thrust of milling, and the ground's support of a drum at rest."""
        return MillingResistance(tool, self._shape, machine_mass, params)

    def release_twist(self, tool: Tool) -> Twist | None:
        """Return the twist of the spinning drum: the picks throw what they cut."""
        return tool.velocity

    def measure(self, particles: SoilEngine, pose: Pose) -> tuple[Payload, float]:
        """Return an empty payload, and infinity: the picks throw all that they cut."""
        return EMPTY_PAYLOAD, math.inf
