"""Fast tracks: one degree of freedom per belt, its shoes placed on the path and felt by the ground.

The shoes are no rigid bodies. They move on the stadium round sprocket and idler, touch the
machine's own copy of the terrain, and what they feel comes back as one wrench on the base.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground import Ground
from machine_sim.machine.description import MachineDescription
from machine_sim.machine.tracks.contact import track_step
from machine_sim.machine.tracks.model import Array, hull_corners, slip_of
from machine_sim.machine.tracks.shoe import bed_under
from machine_sim.machine.urdf import urdf_text

__all__ = ["FastTracks"]


class FastTracks:
    """The two tracks of a machine on the ground; attributes as in `Tracks`."""

    def __init__(self, description: MachineDescription, ground: Ground) -> None:
        """
        Args:
            description: the machine.
            ground: what the shoes touch; its contact surface is read at each step.
        """
        shape = description.tracks
        count = shape.shoe_count
        self.description = description
        self.command: Array = np.zeros(2)
        self.travel: Array = np.zeros(2)
        self.speed: Array = np.zeros(2)
        self.shoe_poses: Array = np.zeros((2, count, 3))
        self.shoe_loads: Array = np.zeros((2, count))
        self.sinkage: Array = np.zeros(2)
        self._mean_paces: Array = np.zeros((2, 2))
        self.wrench: Array = np.zeros(6)
        self._ground = ground
        self._bed = bed_under(ground, shape.shoe_width)
        self._base_com = np.array(description.links["base"].center_of_mass)
        self._hull = hull_corners(description)
        self._anchors: Array = np.zeros((4 * count + len(self._hull), 3))
        self._active: NDArray[np.bool_] = np.zeros(len(self._anchors), dtype=np.bool_)
        self._sheared: Array = np.zeros(len(self._anchors))
        self._shape = (
            0.5 * shape.axle_distance,
            shape.sprocket_radius,
            0.5 * shape.gauge,
            0.5 * shape.shoe_width,
            0.5 * shape.shoe_thickness,
            shape.axle_height,
        )
        self._laws = (  # two contact points share one shoe's
            0.5 * shape.normal_stiffness,
            0.5 * shape.normal_damping,
            0.5 * shape.tangential_stiffness,
            0.5 * shape.tangential_damping,
            shape.friction,
        )
        self._drive = (shape.belt_mass, shape.acceleration, shape.braking, shape.traction)

    @property
    def slip(self) -> Array:
        """See `Tracks`."""
        return slip_of(self._mean_paces)

    @property
    def shoes_in_contact(self) -> int:
        """Number of shoes that carry load."""
        return int(np.count_nonzero(self.shoe_loads))

    def urdf(self) -> str:
        """URDF of the machine; the belts are not in it."""
        return urdf_text(self.description)

    def attach(self, client: int, body: int, position: Array, rotation: Array) -> None:
        """Do nothing: there is nothing of the tracks in the physics engine."""

    def step(
        self,
        dt: float,
        com: Array,
        rotation: Array,
        velocity: Array,
        spin: Array,
        swing: float,
    ) -> Array:
        """Advance the belts and return the ground's wrench on the base, shape (6,).

        Args:
            dt: time step [s].
            com, rotation: base centre of mass [m] and base to map, shape (3, 3).
            velocity, spin: of the centre of mass [m/s] and angular [rad/s], map frame.
            swing: swing angle [rad]; the upper body's corners touch the ground too.
        """
        track_step(
            dt,
            com,
            rotation,
            velocity,
            spin,
            self._base_com,
            self._hull,
            math.cos(swing),
            math.sin(swing),
            self._shape,
            self._laws,
            self._drive,
            self._bed,
            self._ground.surface,
            self.command,
            self.travel,
            self.speed,
            self._anchors,
            self._active,
            self._sheared,
            self.shoe_poses,
            self.shoe_loads,
            self.sinkage,
            self._mean_paces,
            self.wrench,
        )
        return self.wrench
