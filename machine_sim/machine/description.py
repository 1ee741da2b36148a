"""A machine as data: dimensions, masses and limits, read from a YAML file and checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from machine_sim.machine.bucket import KEY_PAIRS, BucketShape
from machine_sim.machine.errors import MachineError
from machine_sim.machine.section import Section

__all__ = [
    "JOINT_NAMES",
    "LINK_NAMES",
    "Box",
    "BucketShape",
    "JointLimits",
    "LinkShape",
    "MachineDescription",
    "TrackShape",
    "load_description",
]

JOINT_NAMES = ("swing", "boom", "arm", "bucket")
"""Joints of an excavator, in the order of every array of joint values."""

LINK_NAMES = ("base", "upper", "boom", "arm", "bucket")
"""Links of an excavator, from the ground up; all but the base move with the joint before them."""

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class Box:
    """A box of a link's shape.

    Attributes:
        size: edge lengths [m].
        center: its middle in the link frame [m].
        pitch: turn about +y [rad].
    """

    size: Vec3
    center: Vec3
    pitch: float


@dataclass(frozen=True)
class LinkShape:
    """Mass and looks of one rigid link.

    Attributes:
        mass: [kg].
        center_of_mass: in the link frame [m].
        inertia_box: edges of the solid box that has the link's moments of inertia [m].
        boxes: what is seen and what other rigid machines touch.
    """

    mass: float
    center_of_mass: Vec3
    inertia_box: Vec3
    boxes: tuple[Box, ...]

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
        torque: greatest drive and hold torque [N m].
        speed: greatest speed [rad/s].
        acceleration: ramp of the speed [rad/s^2].
    """

    lower: float
    upper: float
    torque: float
    speed: float
    acceleration: float


@dataclass(frozen=True)
class TrackShape:
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
    braking: float
    traction: float
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
class MachineDescription:
    """One type of excavator.

    Attributes:
        name: of the type.
        links: shapes by link name (`LINK_NAMES`).
        swing_origin: swing bearing in the base frame [m].
        boom_foot: boom pin in the upper frame [m].
        boom_length, arm_length: pin to pin [m].
        joints: limits by joint name (`JOINT_NAMES`).
        home: joint angles [rad] to start with, shape (4,).
        tracks: the tracks.
        bucket: the tool.
    """

    name: str
    links: Mapping[str, LinkShape]
    swing_origin: Vec3
    boom_foot: Vec3
    boom_length: float
    arm_length: float
    joints: Mapping[str, JointLimits]
    home: NDArray[np.float64]
    tracks: TrackShape
    bucket: BucketShape

    @property
    def mass(self) -> float:
        """Of the whole machine [kg]."""
        return sum(link.mass for link in self.links.values())


def load_description(path: str | Path) -> MachineDescription:
    """Read a machine file.

    Raises:
        MachineError: the file cannot be read, or a key is missing, unknown or out of range.
    """
    path = Path(path)
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise MachineError(
            f"{path} cannot be read as YAML: {error}; give a machine file"
        ) from error
    return _description(Section(values, f"{path.name}: "))


def _description(file: Section) -> MachineDescription:
    links = file.section("links")
    joints = file.section("joints")
    description = MachineDescription(
        name=file.text("name"),
        links={name: _link(links.section(name)) for name in LINK_NAMES},
        swing_origin=_vec3(file, "swing_origin"),
        boom_foot=_vec3(file, "boom_foot"),
        boom_length=file.number("boom_length", positive=True),
        arm_length=file.number("arm_length", positive=True),
        joints={name: _joint(name, joints.section(name)) for name in JOINT_NAMES},
        home=_home(file.section("home")),
        tracks=_tracks(file.section("tracks")),
        bucket=_bucket(file.section("bucket")),
    )
    for section in (links, joints, file):
        section.done()
    if description.boom_foot[1] != 0.0 or description.swing_origin[:2] != (0.0, 0.0):
        raise MachineError(
            "boom_foot must lie in the plane y = 0 and swing_origin on the base frame's z axis:"
            " the arm's kinematics count on it"
        )
    for name, angle in zip(JOINT_NAMES, description.home, strict=True):
        limits = description.joints[name]
        if not limits.lower <= angle <= limits.upper:
            raise MachineError(
                f"home.{name} is {angle}; give an angle from {limits.lower} to {limits.upper} rad,"
                f" the limits of joints.{name}"
            )
    return description


def _vec3(section: Section, key: str, *, positive: bool = False) -> Vec3:
    x, y, z = section.vector(key, 3, positive=positive)
    return x, y, z


def _link(section: Section) -> LinkShape:
    link = LinkShape(
        mass=section.number("mass", positive=True),
        center_of_mass=_vec3(section, "center_of_mass"),
        inertia_box=_vec3(section, "inertia_box", positive=True),
        boxes=tuple(_box(box) for box in section.sections("boxes")),
    )
    section.done()
    return link


def _box(section: Section) -> Box:
    size = _vec3(section, "size", positive=True)
    box = Box(size, _vec3(section, "center"), section.number("pitch"))
    section.done()
    return box


def _joint(name: str, section: Section) -> JointLimits:
    limits = JointLimits(
        lower=section.bound("lower", -math.inf),
        upper=section.bound("upper", math.inf),
        torque=section.number("torque", positive=True),
        speed=section.number("speed", positive=True),
        acceleration=section.number("acceleration", positive=True),
    )
    section.done()
    endless = math.isinf(limits.lower) and math.isinf(limits.upper)
    if endless != (name == "swing") or math.isinf(limits.lower) != math.isinf(limits.upper):
        raise MachineError(
            f"joints.{name}: only swing is continuous (lower and upper null);"
            " give the other joints both limits [rad]"
        )
    if limits.lower >= limits.upper:
        raise MachineError(
            f"joints.{name}.lower is {limits.lower} and upper {limits.upper};"
            " give a lower limit below the upper one"
        )
    return limits


def _home(section: Section) -> NDArray[np.float64]:
    home = np.array([section.number(name) for name in JOINT_NAMES])
    section.done()
    home.setflags(write=False)
    return home


def _tracks(section: Section) -> TrackShape:
    shape = TrackShape(
        axle_distance=section.number("axle_distance", positive=True),
        sprocket_radius=section.number("sprocket_radius", positive=True),
        shoe_count=section.count("shoe_count", low=12),
        gauge=section.number("gauge", positive=True),
        shoe_width=section.number("shoe_width", positive=True),
        shoe_thickness=section.number("shoe_thickness", positive=True),
        belt_mass=section.number("belt_mass", positive=True),
        max_speed=section.number("max_speed", positive=True),
        acceleration=section.number("acceleration", positive=True),
        braking=section.number("braking", positive=True),
        traction=section.number("traction", positive=True),
        friction=section.number("friction", low=0.0),
        normal_stiffness=section.number("normal_stiffness", positive=True),
        normal_damping=section.number("normal_damping", low=0.0),
        tangential_stiffness=section.number("tangential_stiffness", positive=True),
        tangential_damping=section.number("tangential_damping", low=0.0),
    )
    section.done()
    return shape


def _bucket(section: Section) -> BucketShape:
    shape = BucketShape(
        profile=np.array(section.vectors("profile", KEY_PAIRS, 2)),
        width=section.number("width", positive=True),
        plate=section.number("plate", positive=True),
    )
    section.done()
    return shape
