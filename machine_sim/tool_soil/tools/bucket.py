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
from machine_sim.tool_soil.bucket_fill import measure_bucket
from machine_sim.tool_soil.edge_soil import bank_mm3
from machine_sim.tool_soil.payload import Payload
from machine_sim.tool_soil.tools.interaction import ToolMotion
from machine_sim.tool_soil.tools.plate_cutting import PlateCutting
from msg_bridge.contract.rows import Rows

__all__ = ["BucketInteraction"]


class BucketInteraction(PlateCutting):
    """How a bucket acts on soil: plate cutting, and a payload that fills it."""

    def __init__(self, shape: BucketShape, tool_id: int) -> None:
        super().__init__(shape, tool_id)
        self._container = shape

    def sweep(self, motion: ToolMotion) -> Rows:
        """Return the SWEEP rows of one tick."""
        x, y, z = self._sweep.move(motion.start, motion.end)
        # The part of the motion of the cutting edge that is not sideways.
        forward = math.hypot(x, z)
        entering_fraction = forward / (forward + abs(y)) if forward > 0.0 else 0.0
        return self._sweep.rows(int(motion.room_mm3 * entering_fraction))

    def measure(self, particles: SoilEngine, pose: Pose) -> tuple[Payload, float]:
        """Measure the soil in the bucket, and the room for more.

        There is room up to its heaped capacity, and to the level of the soil ahead.
        """
        payload, room_below_level, swell = measure_bucket(self._container, particles, pose)
        room = min(self._container.heaped_capacity - payload.loose_m3, room_below_level)
        return payload, bank_mm3(room, swell)
