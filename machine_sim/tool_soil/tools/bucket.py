"""A bucket: cuts with its edge, compacts with its back, and carries soil.

Soil enters a bucket over its cutting edge and through its opening, not through its sides: of what a
bucket sweeps while it is swung through the ground, its leading side pushes the soil ahead. The room
that it reports to the soil is therefore multiplied by the part of its motion that is not sideways.
It fills as far as its heaped capacity, and as the soil before it is high (`soil_level`).
"""

from __future__ import annotations

import math

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.tool_soil.payload import Payload, measure_payload
from machine_sim.tool_soil.soil_level import room_below_level
from machine_sim.tool_soil.tools.interaction import ToolMotion
from machine_sim.tool_soil.tools.plate_cutting import PlateCutting
from msg_bridge.contract.rows import Rows

__all__ = ["BucketInteraction"]


class BucketInteraction(PlateCutting):
    """How a bucket acts on soil: plate cutting, and a payload that fills it."""

    def __init__(self, shape: BucketShape, tool_id: int) -> None:
        super().__init__(shape, tool_id)
        self._container = shape
        self._edge_middle = shape.key_points[:2].mean(axis=0)

    def sweep(self, motion: ToolMotion) -> Rows:
        """Return the SWEEP rows of one tick."""
        room_mm3 = int(motion.room_mm3 * self._entering_fraction(motion))
        return self._sweep.rows(motion.start, motion.end, room_mm3)

    def _entering_fraction(self, motion: ToolMotion) -> float:
        """Return the part of the motion of the cutting edge that is not sideways, from 0 to 1."""
        (start_rotation, start), (rotation, end) = motion.start, motion.end
        edge = self._edge_middle
        displacement = rotation.dot(edge) + end - start_rotation.dot(edge) - start
        x, y, z = displacement.dot(rotation).tolist()
        forward = math.hypot(x, z)
        return forward / (forward + abs(y)) if forward > 0.0 else 0.0

    def payload(self, particles: SoilEngine, pose: Pose) -> Payload:
        """Measure the soil in the bucket."""
        return measure_payload(self._container, particles, pose)

    def free_volume(self, payload: Payload, particles: SoilEngine, pose: Pose) -> float:
        """Return the room up to its heaped capacity and to the level of the soil ahead [m^3].

        It is negative if the bucket is fuller.
        """
        room = self._container.heaped_capacity - payload.loose_m3
        return min(room, room_below_level(self._container, particles, pose))
