"""Machine specification: a tree of links and joints on two tracks, and the tools on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.box import Box, Vec3
from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulic_cylinder import Cylinder
from machine_sim.machine.hydraulic_motor import HydraulicMotor, TravelMotor
from machine_sim.machine.hydraulic_supply import HydraulicSupply
from machine_sim.machine.reference_machine import ReferenceMachine
from machine_sim.machine.shapes.machine_shapes import MachineShapes
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
"""Name of the root link, which carries the tracks."""

Axis = Literal["x", "y", "z"]


@dataclass(frozen=True)
class LinkSpec:
    """Mass, shape and colour of one rigid link.

    Attributes:
        mass: mass [kg].
        center_of_mass: centre of mass in the link frame [m].
        inertia_box: edges of the solid box that has the link's moments of inertia [m].
        boxes: collision shape with other rigid machines; also the visual shape of a link without
            visual shapes.
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
    """Limits of one joint.

    Attributes:
        lower, upper: angle limits [rad], infinite for a continuous joint.
        max_effort: maximum drive and holding torque [N m]; for a joint with a cylinder, the
            maximum over its range.
        max_velocity: maximum angular speed [rad/s].
        max_acceleration: maximum rate of change of the commanded speed [rad/s^2].
        end_deceleration: maximum deceleration before an angle limit [rad/s^2].
    """

    lower: float
    upper: float
    max_effort: float
    max_velocity: float
    max_acceleration: float
    end_deceleration: float


@dataclass(frozen=True)
class Joint(JointLimits):
    """A revolute joint between two links.

    Attributes:
        parent, child: names of the two links.
        origin: origin of the child frame in the parent frame [m]; at angle 0 the axes of both
            frames are parallel.
        axis: axis of rotation in the child frame.
    """

    parent: str
    child: str
    origin: Vec3
    axis: Axis


@dataclass(frozen=True)
class ImuMount:
    """Mounting position of an inertial measurement unit.

    Attributes:
        name: name of the unit.
        link: link that it is fixed to; the unit's axes are the link's.
        position: position in the link frame [m].
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
    max_acceleration: float
    max_deceleration: float
    max_tractive_effort: float
    friction: float
    normal_stiffness: float
    normal_damping: float
    tangential_stiffness: float
    tangential_damping: float
    motor: TravelMotor | None = None

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
        """Height of the axles above the soles, which are at z = 0 of the base frame [m]."""
        return self.sprocket_radius + 0.5 * self.shoe_thickness


@dataclass(frozen=True, eq=False)
class MachineSpec:
    """One type of machine.

    Attributes:
        name: name of the type.
        links: links by name, `BASE` first, each after its parent.
        joints: joints by name; arrays of joint values have this order, which is that of the
            links they move.
        cylinders: hydraulic cylinders by the name of the joint that they drive.
        motors: hydraulic motors by the name of the joint that they drive.
        supply: pump and valves of cylinders and motors; None without them.
        home: initial joint angles [rad], shape (joints,).
        tracks: dimensions, drive and ground contact of the tracks.
        main_body: name of the link that carries engine and cab; the corners of its first box
            touch the ground when the machine overturns, and its outline is the machine's plan.
        tools: tools in contact with soil, by name.
        joystick_axes: joystick axis and direction (1 or -1) by the name of the joint that they
            move; empty for an excavator with the default pattern.
        imus: inertial measurement units.
        shapes: what the machine looks like.
        references: real machines of the class, for comparison.
    """

    name: str
    links: Mapping[str, LinkSpec]
    joints: Mapping[str, Joint]
    cylinders: Mapping[str, Cylinder]
    motors: Mapping[str, HydraulicMotor]
    supply: HydraulicSupply | None
    home: NDArray[np.float64]
    tracks: TrackSpec
    main_body: str
    tools: Mapping[str, ToolMount]
    joystick_axes: Mapping[str, tuple[str, float]]
    imus: tuple[ImuMount, ...] = ()
    shapes: MachineShapes = field(default_factory=MachineShapes)
    references: tuple[ReferenceMachine, ...] = ()

    @property
    def mass(self) -> float:
        """Mass of the whole machine [kg]."""
        return sum(link.mass for link in self.links.values())

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of every array of joint values."""
        return tuple(self.joints)

    @property
    def can_carry_soil(self) -> bool:
        """Whether one of the tools is a container for soil."""
        return any(tool.shape.can_carry_soil for tool in self.tools.values())

    @property
    def bucket(self) -> BucketShape:
        """The first bucket.

        Raises:
            MachineError: the machine has no bucket.
        """
        for tool in self.tools.values():
            if isinstance(tool.shape, BucketShape):
                return tool.shape
        raise MachineError(f"machine type {self.name} has no bucket; choose one with a bucket")
