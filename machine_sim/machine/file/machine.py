"""Reading a machine file: YAML, every key checked, into a `MachineDescription`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from machine_sim.machine.description import (
    BASE,
    Axis,
    Box,
    ImuMount,
    Joint,
    LinkShape,
    MachineDescription,
    TrackShape,
    Vec3,
)
from machine_sim.machine.errors import MachineError
from machine_sim.machine.file.cylinders import read_cylinder, read_supply, strongest
from machine_sim.machine.file.section import Section
from machine_sim.machine.file.tools import read_tools
from machine_sim.machine.hydraulics import Cylinder, HydraulicSupply
from machine_sim.machine.pistons import piston_parts
from machine_sim.machine.urdf import VIRTUAL_JOINTS

__all__ = ["LEVER_AXES", "load_description"]

LEVER_AXES = ("left_x", "left_y", "right_x", "right_y")
"""Axes of a joystick that can move a joint; positive to the left and forward."""

_TRACKS = ("left_track", "right_track")

_AXES: tuple[Axis, ...] = ("x", "y", "z")


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
    supply = read_supply(file.section("hydraulics")) if file.has("hydraulics") else None
    joints, cylinders = _joints(file.section("joints"), supply)
    links = _links(file.section("links"), joints)
    description = MachineDescription(
        name=file.text("name"),
        links=links,
        joints=joints,
        cylinders=cylinders,
        supply=supply,
        home=_home(file.section("home"), joints),
        tracks=_tracks(file.section("tracks")),
        hull=_hull(file, joints),
        tools=read_tools(file.section("tools"), joints),
        levers=_levers(file.section("levers"), joints) if file.has("levers") else {},
        imus=_imus(file.section("imus"), links) if file.has("imus") else (),
    )
    file.done()
    _refuse_clashes(description)
    return description


def _refuse_clashes(machine: MachineDescription) -> None:
    """
    Raises:
        MachineError: a link or joint is named as something else of the machine is.
    """
    parts = piston_parts(machine)
    joints = {*_TRACKS, *VIRTUAL_JOINTS, *(part.joint for part in parts)}
    links = {"map", "base_link", *(f"{name}_link" for name in VIRTUAL_JOINTS)}
    links |= {part.link for part in parts}
    taken = [*joints.intersection(machine.joints), *links.intersection(machine.links)]
    if taken:
        raise MachineError(
            f"a joint or link is named {', '.join(taken)}, as something else of every machine or of"
            " its cylinders is; give it another name"
        )


def _links(section: Section, joints: Mapping[str, Joint]) -> dict[str, LinkShape]:
    """The base, then what the joints move, in their order."""
    names = [BASE, *(joint.child for joint in joints.values())]
    links = {name: _link(section.section(name)) for name in names}
    section.done()
    return links


def _vec3(section: Section, key: str, *, positive: bool = False) -> Vec3:
    x, y, z = section.vector(key, 3, positive=positive)
    return x, y, z


def _link(section: Section) -> LinkShape:
    link = LinkShape(
        mass=section.number("mass", positive=True),
        center_of_mass=_vec3(section, "center_of_mass"),
        inertia_box=_vec3(section, "inertia_box", positive=True),
        boxes=tuple(_box(box) for box in section.sections("boxes")),
        color=_vec3(section, "color"),
    )
    section.done()
    return link


def _box(section: Section) -> Box:
    size = _vec3(section, "size", positive=True)
    box = Box(size, _vec3(section, "center"), section.number("pitch"))
    section.done()
    return box


def _joints(
    section: Section, supply: HydraulicSupply | None
) -> tuple[dict[str, Joint], dict[str, Cylinder]]:
    """All joints, each behind the one that it hangs on, and the cylinders of those with one."""
    joints: dict[str, Joint] = {}
    cylinders = {}
    there = [BASE]
    for name in section.names():
        joint = section.section(name)
        parent, child = joint.text("parent"), joint.text("child")
        if parent not in there or child in there:
            raise MachineError(
                f"joints.{name} goes from {parent!r} to {child!r}; let it begin at one of"
                f" {', '.join(there)} and end at a link that no joint before it moves"
            )
        there.append(child)
        axis, origin = _axis(name, joint), _vec3(joint, "origin")
        lower, upper = joint.bound("lower", -math.inf), joint.bound("upper", math.inf)
        _check_range(name, lower, upper)
        if joint.has("cylinder") == joint.has("torque"):
            raise MachineError(
                f"joints.{name}: a cylinder turns it or a motor does; give `cylinder` or `torque`"
            )
        if joint.has("cylinder"):
            if supply is None:
                raise MachineError(f"joints.{name}.cylinder: give `hydraulics`, which feed it")
            if math.isinf(lower) or axis != "y" or origin[1] != 0.0:
                raise MachineError(
                    f"joints.{name}: a cylinder turns a joint with limits, about y, in the middle"
                    " of the machine; give it those and origin [x, 0.0, z], or `torque`"
                )
            pin = (origin[0], origin[2])
            cylinder = read_cylinder(name, joint.section("cylinder"), pin, lower, upper)
            cylinders[name] = cylinder
            torque = strongest(cylinder, supply)
        else:
            torque = joint.number("torque", positive=True)
        speed = joint.number("speed", positive=True)
        ramp = joint.number("acceleration", positive=True)
        joints[name] = Joint(lower, upper, torque, speed, ramp, parent, child, origin, axis)
        joint.done()
    return joints, cylinders


def _axis(name: str, section: Section) -> Axis:
    axis = section.text("axis")
    for known in _AXES:
        if axis == known:
            return known
    raise MachineError(f"joints.{name}.axis is {axis!r}; give one of {', '.join(_AXES)}")


def _check_range(name: str, lower: float, upper: float) -> None:
    if math.isinf(lower) != math.isinf(upper):
        raise MachineError(
            f"joints.{name}: give both limits [rad], or null for both where it turns without end"
        )
    if lower >= upper:
        raise MachineError(
            f"joints.{name}.lower is {lower} and upper {upper};"
            " give a lower limit below the upper one"
        )


def _home(section: Section, joints: Mapping[str, Joint]) -> NDArray[np.float64]:
    home = np.array([section.number(name) for name in joints])
    section.done()
    for (name, joint), angle in zip(joints.items(), home, strict=True):
        if not joint.lower <= angle <= joint.upper:
            raise MachineError(
                f"home.{name} is {angle}; give an angle from {joint.lower} to {joint.upper} rad,"
                f" the limits of joints.{name}"
            )
    home.setflags(write=False)
    return home


def _hull(file: Section, joints: Mapping[str, Joint]) -> str:
    hull = file.text("hull")
    turning = [
        joint.child
        for joint in joints.values()
        if joint.parent == BASE and joint.axis == "z" and joint.origin[:2] == (0.0, 0.0)
    ]
    if hull not in (BASE, *turning):
        raise MachineError(
            f"hull is {hull!r}; give {BASE}, or a link that turns about its z axis:"
            f" {', '.join(turning) or 'there is none'}"
        )
    return hull


def _levers(section: Section, joints: Mapping[str, Joint]) -> dict[str, tuple[str, float]]:
    levers = {}
    for name in section.names():
        lever = section.section(name)
        axis, direction = lever.text("axis"), lever.number("direction")
        if name not in joints or axis not in LEVER_AXES or direction == 0.0:
            raise MachineError(
                f"levers.{name}: give a joint ({', '.join(joints)}) and an axis, one of"
                f" {', '.join(LEVER_AXES)}, and a direction of 1 or -1"
            )
        levers[name] = (axis, math.copysign(1.0, direction))
        lever.done()
    return levers


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


def _imus(section: Section, links: Mapping[str, LinkShape]) -> tuple[ImuMount, ...]:
    mounts = []
    for name in section.names():
        mount = section.section(name)
        link = mount.text("link")
        if link not in links:
            raise MachineError(f"imus.{name}.link is {link!r}; give one of {', '.join(links)}")
        mounts.append(ImuMount(name, link, _vec3(mount, "position")))
        mount.done()
    return tuple(mounts)
