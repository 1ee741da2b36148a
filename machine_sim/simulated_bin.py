"""Bin: an open box that stands on the ground, collects soil, and collides with machines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from machine_sim.dem import SoilEngine
from machine_sim.ground.contact_surface import Ground
from machine_sim.machine import MachineError
from machine_sim.machine.rotations import quaternion_from_matrix, rotation_about_z
from machine_sim.machine.tools.bed import BedShape
from machine_sim.physics_engine import pybullet
from machine_sim.tool_soil.payload import Payload, measure_payload

__all__ = ["BinSpec", "SimulatedBin"]

_WALL_THICKNESS = 0.05
"""Thickness of the walls [m]."""


@dataclass(frozen=True)
class BinSpec:
    """Pose and size of a bin.

    Attributes:
        position: centre (x, y) [m], map frame.
        yaw: direction of its length [rad], from +x counter-clockwise.
        length, width, height: inside dimensions [m].
    """

    position: tuple[float, float]
    yaw: float = 0.0
    length: float = 4.0
    width: float = 2.4
    height: float = 1.5

    def __post_init__(self) -> None:
        """
        Raises:
            MachineError: a number that is not finite, or a size that is not above 0.
        """
        sizes = (self.length, self.width, self.height)
        if not all(map(math.isfinite, (*self.position, self.yaw, *sizes))) or min(sizes) <= 0.0:
            raise MachineError(f"{self} is invalid; give finite numbers, and sizes above 0 m")

    @property
    def shape(self) -> BedShape:
        """Shape of the bin; its origin is on the ground, below the centre."""
        half, top = 0.5 * self.length, _WALL_THICKNESS + self.height
        profile = [(-half, top), (-half, _WALL_THICKNESS), (half, _WALL_THICKNESS), (half, top)]
        return BedShape(np.array(profile), self.width, _WALL_THICKNESS)


class SimulatedBin:
    """A bin in the simulation; it stays at its pose when the ground changes.

    Attributes:
        spec: pose and size.
        bodies: ids of its walls in the physics client.
        position, quaternion: pose, map frame: origin [m], shape (3,), and x, y, z, w, (4,).
        payload: soil in it at the end of the last tick.
    """

    def __init__(
        self, spec: BinSpec, client: int, ground: Ground, particles: SoilEngine, tool_id: int
    ) -> None:
        """
        Args:
            spec: pose and size.
            client: id of the physics client.
            ground: ground that the bin stands on.
            particles: engine of the particles that may fall into it.
            tool_id: id that no tool of the node has.

        Raises:
            MachineError: a position off the map.
        """
        x, y = spec.position
        if not ground.grid.contains(x, y):
            raise MachineError(f"({x}, {y}) m is off the map: place the bin on it")
        self.spec, self._shape = spec, spec.shape
        self._particles = particles
        rotation, origin = rotation_about_z(spec.yaw), np.array([x, y, ground.height(x, y)])
        self._pose = rotation, origin
        self.position, self.quaternion = origin, np.array(quaternion_from_matrix(rotation))
        particles.add_tool(tool_id, self._shape.plates(), self._pose, is_digging=False)
        self.bodies: list[int] = []
        for box in self._shape.boxes():
            pitch = np.array(pybullet.getQuaternionFromEuler([0.0, box.pitch, 0.0]))
            position, quaternion = pybullet.multiplyTransforms(
                origin.tolist(), quaternion_from_matrix(rotation), box.center, pitch.tolist()
            )
            half = [0.5 * edge for edge in box.size]
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client
            )
            body = pybullet.createMultiBody(
                0.0, shape, -1, position, quaternion, physicsClientId=client
            )
            self.bodies.append(body)
        self.update_payload()

    def update_payload(self) -> None:
        """Measure the soil in the bin."""
        self.payload: Payload = measure_payload(self._shape, self._particles, self._pose)
