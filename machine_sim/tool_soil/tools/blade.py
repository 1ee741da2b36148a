"""A dozer blade: cuts with its edge, pushes soil ahead of its plate, and carries none."""

from __future__ import annotations

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.blade import BladeShape
from machine_sim.tool_soil.edge_soil import bank_mm3, swell_at_edge
from machine_sim.tool_soil.payload import EMPTY_PAYLOAD, Payload, loose_volume
from machine_sim.tool_soil.tools.plate_cutting import PlateCutting

__all__ = ["BladeInteraction"]


class BladeInteraction(PlateCutting):
    """How a blade acts on soil: plate cutting without a payload.

    What it cuts becomes particles up to its rated capacity; the terrain ahead holds the rest.
    """

    def __init__(self, shape: BladeShape, tool_id: int) -> None:
        super().__init__(shape, tool_id)
        self._blade = shape

    def measure(self, particles: SoilEngine, pose: Pose) -> tuple[Payload, float]:
        """Return an empty payload, and what its capacity exceeds the particles ahead of it by."""
        ahead = self._blade.indices_ahead(particles.positions, *pose)
        free = self._blade.capacity - loose_volume(particles, ahead)
        return EMPTY_PAYLOAD, bank_mm3(free, swell_at_edge(self.key_points, particles, pose))
