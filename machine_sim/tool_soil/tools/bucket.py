"""A bucket: cuts with its edge, compacts with its back, and carries soil."""

from __future__ import annotations

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.tool_soil.payload import Payload, measure_payload
from machine_sim.tool_soil.tools.plate_cutting import PlateCutting

__all__ = ["BucketInteraction"]


class BucketInteraction(PlateCutting):
    """How a bucket acts on soil: plate cutting, and a payload that fills it."""

    def __init__(self, shape: BucketShape, tool_id: int) -> None:
        super().__init__(shape, tool_id)
        self._container = shape

    def payload(self, particles: SoilEngine, pose: Pose) -> Payload:
        """Measure the soil in the bucket."""
        return measure_payload(self._container, particles, pose)

    def free_volume(self, payload: Payload, particles: SoilEngine, pose: Pose) -> float:
        """Return what its heaped capacity exceeds its load by [m^3]; negative if overfull."""
        return self._container.heaped_capacity - payload.loose_m3
