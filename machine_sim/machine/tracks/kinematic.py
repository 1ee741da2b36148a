"""Kinematic tracks: one degree of freedom for each belt, with its shoes placed on the path.

The shoes are not rigid bodies. They move on the path around sprocket and idler and touch the
machine's copy of the terrain; the ground's forces on them act as one wrench on the base.
"""

from __future__ import annotations

import math

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tracks.axle_contact import axle_coefficients
from machine_sim.machine.tracks.kinematic_step import (
    POINTS_PER_SHOE,
    KinematicTables,
    kinematic_track_step,
)
from machine_sim.machine.tracks.track_base import Array, TrackBase
from machine_sim.machine.tracks.track_state import BeltDrive, ContactCoefficients
from machine_sim.machine.urdf import urdf_text
from msg_bridge.kernels import BoxedTable, box_table

__all__ = ["KinematicTracks"]

_MAX_STIFF_AXLE_LOAD = 0.15
"""Load up to which the ground below an axle is stiff, see `axle_coefficients`."""


class KinematicTracks(TrackBase):
    """Tracks with one degree of freedom for each belt; attributes as in `Tracks`."""

    def __init__(self, spec: MachineSpec, ground: Ground) -> None:
        """
        Args:
            spec: specification of the machine.
            ground: terrain under the tracks; its contact surface is read at each step.
        """
        super().__init__(spec, ground, POINTS_PER_SHOE)
        tracks = spec.tracks
        coefficients = ContactCoefficients(  # both contact points share those of the shoe
            0.5 * tracks.normal_stiffness,
            0.5 * tracks.normal_damping,
            0.5 * tracks.tangential_stiffness,
            0.5 * tracks.tangential_damping,
            tracks.friction,
        )
        drive = BeltDrive(
            tracks.belt_mass,
            tracks.max_acceleration,
            tracks.max_deceleration,
            tracks.max_tractive_effort,
        )
        self._tables: BoxedTable = box_table(
            KinematicTables(
                self._dimensions,
                drive,
                coefficients,
                axle_coefficients(spec, _MAX_STIFF_AXLE_LOAD),
                self._soil,
                self._shoe_contacts,
                self._main_body,
                self.command,
                self._state,
            )
        )

    def urdf(self) -> str:
        """Return the URDF of the machine; it has no belts."""
        return urdf_text(self.spec)

    def attach(self, client: int, body: int, position: Array, rotation: Array) -> None:
        """Do nothing: the physics engine has no bodies of these tracks."""

    def step(
        self,
        dt: float,
        motion: Array,
        swing: float,
        actuators: BoxedTable,
    ) -> list[float]:
        """Advance the belts and return the ground's wrench on the base; see `Tracks.step`."""
        kinematic_track_step(dt, motion, math.cos(swing), math.sin(swing), actuators, self._tables)
        wrench: list[float] = self.wrench.tolist()
        return wrench
