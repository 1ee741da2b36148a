"""State and properties that both track models share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tracks.body_contact import main_body_on
from machine_sim.machine.tracks.terramechanics import soil_patch_under
from machine_sim.machine.tracks.track_slip import track_slip
from machine_sim.machine.tracks.track_state import (
    ContactPoints,
    TrackDimensions,
    TrackState,
)

__all__ = ["TrackBase"]

Array = NDArray[np.float64]


class TrackBase:
    """The two tracks of a machine on the ground; attributes as in `Tracks`."""

    def __init__(self, spec: MachineSpec, ground: Ground, points_per_shoe: int) -> None:
        """
        Args:
            spec: machine with the shoes of this track model.
            ground: terrain under the tracks; its contact surface is read at each step.
            points_per_shoe: number of contact points of a shoe.
        """
        shoe_count = spec.tracks.shoe_count
        self.spec = spec
        self.command: Array = np.zeros(2)
        self.num_reseats = [0, 0]
        state = TrackState.zeros(shoe_count)
        self.travel = state.travel
        self.speed = state.speed
        self.shoe_poses = state.shoe_poses
        self.shoe_loads = state.shoe_loads
        self.sinkage = state.sinkage
        self.drive_forces = state.drive_forces
        self.wrench = state.wrench
        self._mean_speeds = state.mean_speeds
        self._state = state
        self._dimensions = TrackDimensions.of(spec)
        self._soil = soil_patch_under(ground, spec.tracks.shoe_width)
        self._shoe_contacts = ContactPoints.inactive(2 * shoe_count * points_per_shoe)
        self._main_body = main_body_on(ground, spec)

    @property
    def slip(self) -> Array:
        """Slip of each track, averaged over half a second, shape (2,); see `track_slip`."""
        return track_slip(self._mean_speeds)
