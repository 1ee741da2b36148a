"""A machine as data: a tree of links and joints on two tracks, and the tools on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.box import Box, Vec3
from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulics import Cylinder, HydraulicSupply
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.shapes import ToolMount

__all__ = [
    "BASE",
    "Axis",
    "Box",
    "ImuMount",
    "Joint",
    "JointLimits",
    "LinkSpec",
    "MachineSpec",
    "TrackSpec",
    "Vec3",
]

BASE = "base"
"""The link that is on the tracks; all others hang on it by joints."""

Axis = Literal["x", "y", "z"]


@dataclass(frozen=True)
class LinkSpec:
    """Mass and looks of one rigid link.

    Attributes:
        mass: [kg].
        center_of_mass: in the link frame [m].
        inertia_box: edges of the solid box that has the link's moments of inertia [m].
        boxes: what is seen and what other rigid machines touch.
        color: red, green, blue, 0 to 1.
    """

    mass: float
    center_of_mass: Vec3
    inertia_box: Vec3
    boxes: tuple[Box, ...]
    color: Vec3

    @property
    def inertia(self) -> Vec3:
        """Principal moments of inertia about the centre of mass [kg m^2]."""
        x, y, z = self.inertia_box
        twelfth = self.mass / 12.0
        return twelfth * (y * y + z * z), twelfth * (x * x + z * z), twelfth * (x * x + y * y)


@dataclass(frozen=True)
class JointLimits:
    """What one joint can do.

    Attributes:
        lower, upper: angle limits [rad], infinite for a continuous joint.
        torque: greatest drive and hold torque [N m]; with a cylinder, where that is strongest.
        speed: greatest speed [rad/s].
        acceleration: ramp of the speed [rad/s^2].
    """

    lower: float
    upper: float
    torque: float
    speed: float
    acceleration: float


@dataclass(frozen=True)
class Joint(JointLimits):
    """How a link hangs on another one, and what moves it.

    Attributes:
        parent, child: links before and behind it.
        origin: of the child's frame in the parent's [m]; at angle 0 both have the same axes.
        axis: of the child's frame that it turns about.
    """

    parent: str
    child: str
    origin: Vec3
    axis: Axis


@dataclass(frozen=True)
class ImuMount:
    """Where an inertial unit is.

    Attributes:
        name: of the unit.
        link: that it is fixed to, with that link's axes.
        position: in the link frame [m].
    """

    name: str
    link: str
    position: Vec3


@dataclass(frozen=True)
class TrackSpec:
    """A pair of tracks, in SI units; config/machines/excavator.yaml explains each value."""

    axle_distance: float
    sprocket_radius: float
    shoe_count: int
    gauge: float
    shoe_width: float
    shoe_thickness: float
    belt_mass: float
    max_speed: float
    acceleration: float
    braking_deceleration: float
    max_tractive_effort: float
    friction: float
    normal_stiffness: float
    normal_damping: float
    tangential_stiffness: float
    tangential_damping: float

    @property
    def belt_length(self) -> float:
        """Length of the pitch line [m]."""
        return 2.0 * self.axle_distance + 2.0 * math.pi * self.sprocket_radius

    @property
    def pitch(self) -> float:
        """Distance between neighbouring shoes [m]."""
        return self.belt_length / self.shoe_count

    @property
    def axle_height(self) -> float:
        """Axles above the soles, which is z = 0 of the base frame [m]."""
        return self.sprocket_radius + 0.5 * self.shoe_thickness


@dataclass(frozen=True, eq=False)
class MachineSpec:
    """One type of machine.

    Attributes:
        name: of the type.
        links: shapes by link name, `BASE` first, each after the one that it hangs on.
        joints: by name, in the order of every array of joint values: that of the links they move.
        cylinders: of the joints that cylinders turn, by joint name.
        supply: pump and valves of the cylinders; None where there are none.
        home: joint angles [rad] to start with, shape (joints,).
        tracks: the tracks.
        hull: link whose first box meets the ground where the machine falls over.
        tools: what touches soil, by name.
        levers: axis and direction of the joystick that moves a joint, by joint name; an
            excavator's levers need not be told.
        imus: inertial units, none if the file names none.
    """

    name: str
    links: Mapping[str, LinkSpec]
    joints: Mapping[str, Joint]
    cylinders: Mapping[str, Cylinder]
    supply: HydraulicSupply | None
    home: NDArray[np.float64]
    tracks: TrackSpec
    hull: str
    tools: Mapping[str, ToolMount]
    joystick_axes: Mapping[str, tuple[str, float]]
    imus: tuple[ImuMount, ...] = ()

    @property
    def mass(self) -> float:
        """Of the whole machine [kg]."""
        return sum(link.mass for link in self.links.values())

    @property
    def joint_names(self) -> tuple[str, ...]:
        """In the order of every array of joint values."""
        return tuple(self.joints)

    @property
    def can_carry_soil(self) -> bool:
        """Whether soil is carried in one of its tools."""
        return any(tool.shape.can_carry_soil for tool in self.tools.values())

    @property
    def bucket(self) -> BucketShape:
        """The bucket of a machine that has one.

        Raises:
            MachineError: it has none.
        """
        for tool in self.tools.values():
            if isinstance(tool.shape, BucketShape):
                return tool.shape
        raise MachineError(f"a {self.name} has no bucket: give a machine that digs with one")
