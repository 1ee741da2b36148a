"""Reading a machine file: YAML, every key checked, into a `MachineSpec`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from machine_sim.machine.cylinder_visuals import cylinder_parts
from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulics import Cylinder, HydraulicSupply
from machine_sim.machine.spec import (
    BASE,
    Axis,
    Box,
    ImuMount,
    Joint,
    LinkSpec,
    MachineSpec,
    TrackSpec,
    Vec3,
)
from machine_sim.machine.spec_file.cylinders import max_joint_torque, read_cylinder, read_supply
from machine_sim.machine.spec_file.section import Section
from machine_sim.machine.spec_file.tools import read_tools
from machine_sim.machine.urdf import BASE_JOINTS

__all__ = ["JOYSTICK_AXES", "load_machine_spec"]

JOYSTICK_AXES = ("left_x", "left_y", "right_x", "right_y")
"""Axes of a joystick that can move a joint; positive to the left and forward."""

_TRACK_COMMAND_NAMES = ("left_track", "right_track")

_AXES: tuple[Axis, ...] = ("x", "y", "z")


def load_machine_spec(path: str | Path) -> MachineSpec:
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
    return _build_spec(Section(values, f"{path.name}: "))


def _build_spec(file: Section) -> MachineSpec:
    supply = read_supply(file.section("hydraulics")) if file.has("hydraulics") else None
    joints, cylinders = _read_joints(file.section("joints"), supply)
    links = _read_links(file.section("links"), joints)
    spec = MachineSpec(
        name=file.text("name"),
        links=links,
        joints=joints,
        cylinders=cylinders,
        supply=supply,
        home=_read_home(file.section("home"), joints),
        tracks=_read_tracks(file.section("tracks")),
        hull=_read_hull(file, joints),
        tools=read_tools(file.section("tools"), joints),
        joystick_axes=_joystick_axes(file.section("joystick_axes"), joints)
        if file.has("joystick_axes")
        else {},
        imus=_read_imus(file.section("imus"), links) if file.has("imus") else (),
    )
    file.reject_unknown_keys()
    _check_unique_names(spec)
    return spec


def _check_unique_names(machine: MachineSpec) -> None:
    """
    Raises:
        MachineError: a link or joint is named as something else of the machine is.
    """
    parts = cylinder_parts(machine)
    joints = {*_TRACK_COMMAND_NAMES, *BASE_JOINTS, *(part.joint for part in parts)}
    links = {"map", "base_link", *(f"{name}_link" for name in BASE_JOINTS)}
    links |= {part.link for part in parts}
    taken = [*joints.intersection(machine.joints), *links.intersection(machine.links)]
    if taken:
        raise MachineError(
            f"a joint or link is named {', '.join(taken)}, as something else of every machine or of"
            " its cylinders is; give it another name"
        )


def _read_links(section: Section, joints: Mapping[str, Joint]) -> dict[str, LinkSpec]:
    """The base, then what the joints move, in their order."""
    names = [BASE, *(joint.child for joint in joints.values())]
    links = {name: _read_link(section.section(name)) for name in names}
    section.reject_unknown_keys()
    return links


def _read_vec3(section: Section, key: str, *, positive: bool = False) -> Vec3:
    x, y, z = section.vector(key, 3, positive=positive)
    return x, y, z


def _read_link(section: Section) -> LinkSpec:
    link = LinkSpec(
        mass=section.number("mass", positive=True),
        center_of_mass=_read_vec3(section, "center_of_mass"),
        inertia_box=_read_vec3(section, "inertia_box", positive=True),
        boxes=tuple(_read_box(box) for box in section.sections("boxes")),
        color=_read_vec3(section, "color"),
    )
    section.reject_unknown_keys()
    return link


def _read_box(section: Section) -> Box:
    size = _read_vec3(section, "size", positive=True)
    box = Box(size, _read_vec3(section, "center"), section.number("pitch"))
    section.reject_unknown_keys()
    return box


def _read_joints(
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
        axis, origin = _read_axis(name, joint), _read_vec3(joint, "origin")
        lower, upper = joint.number_or("lower", -math.inf), joint.number_or("upper", math.inf)
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
            torque = max_joint_torque(cylinder, supply)
        else:
            torque = joint.number("torque", positive=True)
        speed = joint.number("speed", positive=True)
        ramp = joint.number("acceleration", positive=True)
        joints[name] = Joint(lower, upper, torque, speed, ramp, parent, child, origin, axis)
        joint.reject_unknown_keys()
    return joints, cylinders


def _read_axis(name: str, section: Section) -> Axis:
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


def _read_home(section: Section, joints: Mapping[str, Joint]) -> NDArray[np.float64]:
    home = np.array([section.number(name) for name in joints])
    section.reject_unknown_keys()
    for (name, joint), angle in zip(joints.items(), home, strict=True):
        if not joint.lower <= angle <= joint.upper:
            raise MachineError(
                f"home.{name} is {angle}; give an angle from {joint.lower} to {joint.upper} rad,"
                f" the limits of joints.{name}"
            )
    home.setflags(write=False)
    return home


def _read_hull(file: Section, joints: Mapping[str, Joint]) -> str:
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


def _joystick_axes(section: Section, joints: Mapping[str, Joint]) -> dict[str, tuple[str, float]]:
    joystick_axes = {}
    for name in section.names():
        lever = section.section(name)
        axis, direction = lever.text("axis"), lever.number("direction")
        if name not in joints or axis not in JOYSTICK_AXES or direction == 0.0:
            raise MachineError(
                f"joystick_axes.{name}: give a joint ({', '.join(joints)}) and an axis, one of"
                f" {', '.join(JOYSTICK_AXES)}, and a direction of 1 or -1"
            )
        joystick_axes[name] = (axis, math.copysign(1.0, direction))
        lever.reject_unknown_keys()
    return joystick_axes


def _read_tracks(section: Section) -> TrackSpec:
    shape = TrackSpec(
        axle_distance=section.number("axle_distance", positive=True),
        sprocket_radius=section.number("sprocket_radius", positive=True),
        shoe_count=section.count("shoe_count", low=12),
        gauge=section.number("gauge", positive=True),
        shoe_width=section.number("shoe_width", positive=True),
        shoe_thickness=section.number("shoe_thickness", positive=True),
        belt_mass=section.number("belt_mass", positive=True),
        max_speed=section.number("max_speed", positive=True),
        acceleration=section.number("acceleration", positive=True),
        braking_deceleration=section.number("braking_deceleration", positive=True),
        max_tractive_effort=section.number("max_tractive_effort", positive=True),
        friction=section.number("friction", low=0.0),
        normal_stiffness=section.number("normal_stiffness", positive=True),
        normal_damping=section.number("normal_damping", low=0.0),
        tangential_stiffness=section.number("tangential_stiffness", positive=True),
        tangential_damping=section.number("tangential_damping", low=0.0),
    )
    section.reject_unknown_keys()
    return shape


def _read_imus(section: Section, links: Mapping[str, LinkSpec]) -> tuple[ImuMount, ...]:
    mounts = []
    for name in section.names():
        mount = section.section(name)
        link = mount.text("link")
        if link not in links:
            raise MachineError(f"imus.{name}.link is {link!r}; give one of {', '.join(links)}")
        mounts.append(ImuMount(name, link, _read_vec3(mount, "position")))
        mount.reject_unknown_keys()
    return tuple(mounts)
