"""Fast tracks: one degree of freedom per belt, its shoes placed on the path and felt by the ground.

The shoes are no rigid bodies. They move on the stadium round sprocket and idler, touch the
machine's own copy of the terrain, and what they feel comes back as one wrench on the base.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tracks.kinematic_step import kinematic_track_step
from machine_sim.machine.tracks.terramechanics import soil_patch_under
from machine_sim.machine.tracks.track_model import Array, hull_corners, track_slip
from machine_sim.machine.urdf import urdf_text

__all__ = ["KinematicTracks"]


class KinematicTracks:
    """The two tracks of a machine on the ground; attributes as in `Tracks`."""

    def __init__(self, spec: MachineSpec, ground: Ground) -> None:
        """
        Args:
            description: the machine.
            ground: what the shoes touch; its contact surface is read at each step.
        """
        shape = spec.tracks
        count = shape.shoe_count
        self.spec = spec
        self.command: Array = np.zeros(2)
        self.travel: Array = np.zeros(2)
        self.speed: Array = np.zeros(2)
        self.shoe_poses: Array = np.zeros((2, count, 3))
        self.shoe_loads: Array = np.zeros((2, count))
        self.sinkage: Array = np.zeros(2)
        self._mean_speeds: Array = np.zeros((2, 2))
        self.wrench: Array = np.zeros(6)
        self._ground = ground
        self._soil_patch = soil_patch_under(ground, shape.shoe_width)
        self._base_com = np.array(spec.links["base"].center_of_mass)
        self._hull = hull_corners(spec)
        self._anchors: Array = np.zeros((4 * count + len(self._hull), 3))
        self._active: NDArray[np.bool_] = np.zeros(len(self._anchors), dtype=np.bool_)
        self._shear_displacement: Array = np.zeros(len(self._anchors))
        self._shape = (
            0.5 * shape.axle_distance,
            shape.sprocket_radius,
            0.5 * shape.gauge,
            0.5 * shape.shoe_width,
            0.5 * shape.shoe_thickness,
            shape.axle_height,
        )
        self._contact_coefficients = (  # two contact points share one shoe's
            0.5 * shape.normal_stiffness,
            0.5 * shape.normal_damping,
            0.5 * shape.tangential_stiffness,
            0.5 * shape.tangential_damping,
            shape.friction,
        )
        self._drive = (
            shape.belt_mass,
            shape.max_acceleration,
            shape.max_deceleration,
            shape.max_tractive_effort,
        )

    @property
    def slip(self) -> Array:
        """See `Tracks`."""
        return track_slip(self._mean_speeds)

    @property
    def shoes_in_contact(self) -> int:
        """Number of shoes that carry load."""
        return int(np.count_nonzero(self.shoe_loads))

    def urdf(self) -> str:
        """URDF of the machine; the belts are not in it."""
        return urdf_text(self.spec)

    def attach(self, client: int, body: int, position: Array, rotation: Array) -> None:
        """Do nothing: there is nothing of the tracks in the physics engine."""

    def step(
        self,
        dt: float,
        com: Array,
        rotation: Array,
        velocity: Array,
        angular_velocity: Array,
        swing: float,
    ) -> Array:
        """Advance the belts and return the ground's wrench on the base, shape (6,).

        Args:
            dt: time step [s].
            com, rotation: base centre of mass [m] and base to map, shape (3, 3).
            velocity, spin: of the centre of mass [m/s] and angular [rad/s], map frame.
            swing: swing angle [rad]; the upper body's corners touch the ground too.
        """
        kinematic_track_step(
            dt,
            com,
            rotation,
            velocity,
            angular_velocity,
            self._base_com,
            self._hull,
            math.cos(swing),
            math.sin(swing),
            self._shape,
            self._contact_coefficients,
            self._drive,
            self._soil_patch,
            self._ground.surface,
            self.command,
            self.travel,
            self.speed,
            self._anchors,
            self._active,
            self._shear_displacement,
            self.shoe_poses,
            self.shoe_loads,
            self.sinkage,
            self._mean_speeds,
            self.wrench,
        )
        return self.wrench
