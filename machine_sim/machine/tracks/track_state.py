"""Parameters and state of the tracks, as the track kernels take them.

Python passes these structures to a kernel boxed (`msg_bridge.kernels.boxed`), or else as plain
tuples whose names the kernel restores: Numba resolves the type of a plain tuple in C, but that of a
`NamedTuple` in Python at every call, which takes about 0.5 us for each element.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.box import Vec3
from machine_sim.machine.spec import BASE, MachineSpec

__all__ = [
    "BELT_SPEED",
    "GROUND_SPEED",
    "SHOE_PITCH",
    "SHOE_X",
    "SHOE_Z",
    "BeltDrive",
    "ContactCoefficients",
    "ContactPoints",
    "TrackDimensions",
    "TrackState",
]

Array = NDArray[np.float64]

SHOE_X, SHOE_Z, SHOE_PITCH = range(3)
"""Slots of `TrackState.shoe_poses`."""

BELT_SPEED, GROUND_SPEED = range(2)
"""Slots of `TrackState.mean_speeds`."""


class TrackDimensions(NamedTuple):
    """Dimensions of the tracks in the base frame.

    Attributes:
        half_axle_distance: half the distance between the axles of sprocket and idler [m].
        sprocket_radius: radius of the pitch line, on which the hinges of the shoes run [m].
        half_gauge: lateral distance of each track's middle from the machine's middle [m].
        half_width, half_thickness: half width and half thickness of a shoe [m].
        axle_height: height of both axles [m].
        base_com: centre of mass of the base [m], shape (3,).
    """

    half_axle_distance: float
    sprocket_radius: float
    half_gauge: float
    half_width: float
    half_thickness: float
    axle_height: float
    base_com: Vec3

    @classmethod
    def of(cls, spec: MachineSpec) -> Self:
        """Return the dimensions of a machine's tracks."""
        tracks = spec.tracks
        return cls(
            half_axle_distance=0.5 * tracks.axle_distance,
            sprocket_radius=tracks.sprocket_radius,
            half_gauge=0.5 * tracks.gauge,
            half_width=0.5 * tracks.shoe_width,
            half_thickness=0.5 * tracks.shoe_thickness,
            axle_height=tracks.axle_height,
            base_com=spec.links[BASE].center_of_mass,
        )


class ContactCoefficients(NamedTuple):
    """Coefficients of one contact point on the ground.

    Attributes:
        normal_stiffness, tangential_stiffness: springs [N/m].
        normal_damping, tangential_damping: dampers [N s/m].
        friction: Coulomb coefficient.
        max_stiff_load: load up to which the normal spring has this stiffness [N].
        residual_stiffness: stiffness of the normal spring at larger loads [N/m].
    """

    normal_stiffness: float
    normal_damping: float
    tangential_stiffness: float
    tangential_damping: float
    friction: float
    max_stiff_load: float = math.inf
    residual_stiffness: float = 0.0


class BeltDrive(NamedTuple):
    """Drive of one belt.

    Attributes:
        belt_mass: moving mass of the belt [kg].
        max_acceleration, max_deceleration: limits while driving and while braking [m/s^2].
        max_tractive_effort: maximum drive and brake force [N].
    """

    belt_mass: float
    max_acceleration: float
    max_deceleration: float
    max_tractive_effort: float


class ContactPoints(NamedTuple):
    """Bristles of contact points: springs from each point to its anchor on the ground.

    Attributes:
        anchors: anchors of the bristles [m], map frame, shape (n, 3).
        is_active: whether each point is in contact, shape (n,).
        shear_displacement: plastic shear displacement of the soil under each point since it came
            into contact [m], shape (n,).
    """

    anchors: Array
    is_active: NDArray[np.bool_]
    shear_displacement: Array

    @classmethod
    def inactive(cls, count: int) -> Self:
        """Return a number of points without contact."""
        return cls(np.zeros((count, 3)), np.zeros(count, dtype=np.bool_), np.zeros(count))

    def release(self, side: int) -> None:
        """End the contact of one side: the first half of the points is the left track's."""
        self.is_active.reshape(2, -1)[side] = False


class TrackState(NamedTuple):
    """State of both tracks, left first.

    Attributes:
        travel: distance that each belt has run, modulo its length [m], shape (2,).
        speed: belt speeds relative to the machine [m/s], shape (2,).
        shoe_poses: x, z [m] and pitch about +y [rad] of each shoe in the base frame (slots
            `SHOE_X`, `SHOE_Z`, `SHOE_PITCH`), shape (2, shoe_count, 3).
        shoe_loads: normal load on each shoe [N], shape (2, shoe_count).
        sinkage: mean depth of the soles below the undisturbed ground, weighted by load [m],
            shape (2,).
        mean_speeds: moving average of each belt's speed and of the speed of its side over the
            ground (slots `BELT_SPEED`, `GROUND_SPEED`) [m/s], shape (2, 2).
        drive_forces: force of each drive on its belt [N], positive forward, shape (2,).
        wrench: force [N] and torque about the base's centre of mass [N m] of the ground on the
            machine, map frame, shape (6,).
    """

    travel: Array
    speed: Array
    shoe_poses: Array
    shoe_loads: Array
    sinkage: Array
    mean_speeds: Array
    drive_forces: Array
    wrench: Array

    @classmethod
    def zeros(cls, shoe_count: int) -> Self:
        """Return the state of tracks at rest without ground contact."""
        return cls(
            travel=np.zeros(2),
            speed=np.zeros(2),
            shoe_poses=np.zeros((2, shoe_count, 3)),
            shoe_loads=np.zeros((2, shoe_count)),
            sinkage=np.zeros(2),
            mean_speeds=np.zeros((2, 2)),
            drive_forces=np.zeros(2),
            wrench=np.zeros(6),
        )
