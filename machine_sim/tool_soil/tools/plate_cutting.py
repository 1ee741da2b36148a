"""Plate cutting: what tools with a cutting edge and plates behind it have in common."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine import Tool
from machine_sim.machine.tools.shapes import PlateCuttingShape
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.payload import EMPTY_PAYLOAD, Payload
from machine_sim.tool_soil.pending_soil import PendingSoil
from machine_sim.tool_soil.resistance import SoilResistance
from machine_sim.tool_soil.sweep import PlateSweep
from machine_sim.tool_soil.tools.interaction import ToolMotion, Twist
from msg_bridge.contract.rows import Rows

__all__ = ["PlateCutting"]


class PlateCutting:
    """How a tool that cuts with an edge acts on soil; see `ToolInteraction`."""

    is_digging = True
    is_milling = False

    def __init__(self, shape: PlateCuttingShape, tool_id: int) -> None:
        """
        Args:
            shape: shape of the tool.
            tool_id: id of the tool in rows.
        """
        self._shape = shape
        self._sweep = PlateSweep(shape.key_points, shape.outward_normals, tool_id)

    @property
    def key_points(self) -> NDArray[np.float64]:
        """Key points of the cutting contour [m], tool frame, shape (n, 3)."""
        return self._shape.key_points

    def sweep(self, motion: ToolMotion) -> Rows:
        """Return the SWEEP rows of one tick."""
        self._sweep.move(motion.start, motion.end)
        return self._sweep.rows(motion.room_mm3)

    def make_pending(
        self, rng: np.random.Generator, *, nominal_mm3: int, max_per_tick: int
    ) -> PendingSoil:
        """Return an empty account of excavated soil."""
        return PendingSoil(self._shape, rng, nominal_mm3=nominal_mm3, max_per_tick=max_per_tick)

    def make_resistance(
        self, tool: Tool, machine_mass: float, params: MachineSimParams
    ) -> SoilResistance:
        """Return the resistance to cutting, and the ground's support of the plates."""
        return SoilResistance(tool.mass, machine_mass, params.physics_step)

    def release_twist(self, tool: Tool) -> Twist | None:
        """Return None: cut soil starts at rest."""
        return None

    def measure(self, particles: SoilEngine, pose: Pose) -> tuple[Payload, float]:
        """Return an empty payload, and infinity: the tool is no container."""
        return EMPTY_PAYLOAD, math.inf
