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
from machine_sim.machine.hydraulics import Cylinder, HydraulicSupply
from machine_sim.machine.linkage import CylinderLinkage, Point, Rocker
from machine_sim.machine.section import Section

__all__ = [
    "JOINT_NAMES",
    "LINK_NAMES",
    "Box",
    "BucketShape",
    "ImuMount",
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
        cylinders: of the joints that cylinders turn, by joint name.
        supply: pump and valves of the cylinders; None where there are none.
        home: joint angles [rad] to start with, shape (4,).
        tracks: the tracks.
        bucket: the tool.
        imus: inertial units, none if the file names none.
    """

    name: str
    links: Mapping[str, LinkShape]
    swing_origin: Vec3
    boom_foot: Vec3
    boom_length: float
    arm_length: float
    joints: Mapping[str, JointLimits]
    cylinders: Mapping[str, Cylinder]
    supply: HydraulicSupply | None
    home: NDArray[np.float64]
    tracks: TrackShape
    bucket: BucketShape
    imus: tuple[ImuMount, ...] = ()

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
    supply = _supply(file.section("hydraulics")) if file.has("hydraulics") else None
    swing_origin, boom_foot = _vec3(file, "swing_origin"), _vec3(file, "boom_foot")
    if boom_foot[1] != 0.0 or swing_origin[:2] != (0.0, 0.0):
        raise MachineError(
            "boom_foot must lie in the plane y = 0 and swing_origin on the base frame's z axis:"
            " the arm's kinematics count on it"
        )
    boom_length = file.number("boom_length", positive=True)
    arm_length = file.number("arm_length", positive=True)
    pins = {
        "boom": (boom_foot[0], boom_foot[2]),
        "arm": (boom_length, 0.0),
        "bucket": (arm_length, 0.0),
    }
    joints, cylinders = _joints(file, pins, supply)
    description = MachineDescription(
        name=file.text("name"),
        links={name: _link(links.section(name)) for name in LINK_NAMES},
        swing_origin=swing_origin,
        boom_foot=boom_foot,
        boom_length=boom_length,
        arm_length=arm_length,
        joints=joints,
        cylinders=cylinders,
        supply=supply,
        home=_home(file.section("home")),
        tracks=_tracks(file.section("tracks")),
        bucket=_bucket(file.section("bucket")),
        imus=_imus(file.section("imus")) if file.has("imus") else (),
    )
    for section in (links, file):
        section.done()
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


def _joints(
    file: Section, pins: Mapping[str, Point], supply: HydraulicSupply | None
) -> tuple[dict[str, JointLimits], dict[str, Cylinder]]:
    """All joints, and the cylinders of those that have one, pinned beside the joints' `pins`."""
    sections = file.section("joints")
    joints, cylinders = {}, {}
    for name in JOINT_NAMES:
        section = sections.section(name)
        lower, upper = section.bound("lower", -math.inf), section.bound("upper", math.inf)
        _check_range(name, lower, upper)
        if section.has("cylinder") == section.has("torque"):
            raise MachineError(
                f"joints.{name}: a cylinder turns it or a motor does; give `cylinder` or `torque`"
            )
        if section.has("cylinder"):
            if supply is None or name not in pins:
                raise MachineError(
                    f"joints.{name}.cylinder: give `hydraulics`, which feed it"
                    if supply is None
                    else f"joints.{name}: no cylinder turns a joint without end; give `torque`"
                )
            cylinder = _cylinder(name, section.section("cylinder"), pins[name], lower, upper)
            cylinders[name] = cylinder
            torque = _strongest(cylinder, supply)
        else:
            torque = section.number("torque", positive=True)
        joints[name] = JointLimits(
            lower,
            upper,
            torque,
            speed=section.number("speed", positive=True),
            acceleration=section.number("acceleration", positive=True),
        )
        section.done()
    sections.done()
    return joints, cylinders


def _check_range(name: str, lower: float, upper: float) -> None:
    endless = math.isinf(lower) and math.isinf(upper)
    if endless != (name == "swing") or math.isinf(lower) != math.isinf(upper):
        raise MachineError(
            f"joints.{name}: only swing is continuous (lower and upper null);"
            " give the other joints both limits [rad]"
        )
    if lower >= upper:
        raise MachineError(
            f"joints.{name}.lower is {lower} and upper {upper};"
            " give a lower limit below the upper one"
        )


def _cylinder(name: str, section: Section, joint: Point, lower: float, upper: float) -> Cylinder:
    rocker = _rocker(section.section("rocker")) if section.has("rocker") else None
    rod = _point(section, "rod") if section.has("rod") else None
    try:
        linkage = CylinderLinkage(joint, _point(section, "barrel"), rod, rocker, lower, upper)
    except MachineError as error:
        raise MachineError(f"joints.{name}.cylinder: {error}") from error
    cylinder = Cylinder(
        linkage,
        bore=section.number("bore", positive=True),
        rod_diameter=section.number("rod_diameter", positive=True),
        count=section.count("count", low=1),
        spread=section.number("spread", low=0.0),
        cushion=section.number("cushion", positive=True),
    )
    section.done()
    if cylinder.rod_diameter >= cylinder.bore:
        raise MachineError(
            f"joints.{name}.cylinder.rod_diameter is {cylinder.rod_diameter}; give less than the"
            f" bore of {cylinder.bore} m"
        )
    if linkage.longest >= 2.0 * linkage.shortest:
        raise MachineError(
            f"joints.{name}.cylinder grows from {linkage.shortest:.3f} to {linkage.longest:.3f} m,"
            " more than its rod is long; move a pin, or narrow the joint's limits"
        )
    return cylinder


def _rocker(section: Section) -> Rocker:
    rocker = Rocker(
        pin=_point(section, "pin"),
        length=section.number("length", positive=True),
        coupler=section.number("coupler", positive=True),
        ear=_point(section, "ear"),
    )
    section.done()
    return rocker


def _point(section: Section, key: str) -> Point:
    x, z = section.vector(key, 2)
    return x, z


def _strongest(cylinder: Cylinder, supply: HydraulicSupply) -> float:
    """Greatest torque within the joint's limits [N m], driven either way."""
    linkage = cylinder.linkage
    step = (linkage.upper - linkage.lower) / 100
    lever = max(abs(linkage.lever(linkage.lower + k * step)) for k in range(101))
    push = cylinder.force_limit(supply.relief_pressure, supply.return_pressure, pushes=True)
    return lever * push


def _supply(section: Section) -> HydraulicSupply:
    supply = HydraulicSupply(
        relief_pressure=section.number("relief_pressure", positive=True),
        hold_pressure=section.number("hold_pressure", positive=True),
        return_pressure=section.number("return_pressure", low=0.0),
        pump_flow=section.number("pump_flow", positive=True),
        pump_power=section.number("pump_power", positive=True),
    )
    section.done()
    if not supply.return_pressure < supply.relief_pressure <= supply.hold_pressure:
        raise MachineError(
            "hydraulics: give return_pressure below relief_pressure, and hold_pressure no lower"
            " than that"
        )
    return supply


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


def _imus(section: Section) -> tuple[ImuMount, ...]:
    mounts = []
    for name in section.names():
        mount = section.section(name)
        link = mount.text("link")
        if link not in LINK_NAMES:
            raise MachineError(f"imus.{name}.link is {link!r}; give one of {', '.join(LINK_NAMES)}")
        mounts.append(ImuMount(name, link, _vec3(mount, "position")))
        mount.done()
    return tuple(mounts)


def _bucket(section: Section) -> BucketShape:
    shape = BucketShape(
        profile=np.array(section.vectors("profile", KEY_PAIRS, 2)),
        width=section.number("width", positive=True),
        plate=section.number("plate", positive=True),
    )
    section.done()
    return shape
