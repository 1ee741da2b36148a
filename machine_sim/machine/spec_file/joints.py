"""Reads the joints of a machine file, their initial angles and joystick axes."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.box import Vec3
from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulic_cylinder import Cylinder
from machine_sim.machine.hydraulic_motor import HydraulicMotor
from machine_sim.machine.hydraulic_supply import HydraulicSupply
from machine_sim.machine.spec import BASE, Axis, Joint
from machine_sim.machine.spec_file.cylinders import max_joint_torque, read_cylinder
from machine_sim.machine.spec_file.motors import read_motor
from machine_sim.machine.spec_file.section import Section

__all__ = ["read_home", "read_joints", "read_joystick_axes", "read_main_body"]

_JOYSTICK_AXES = ("left_x", "left_y", "right_x", "right_y")
"""Joystick axes that can move a joint; positive to the left and forward."""

_DRIVES = ("cylinder", "motor", "max_effort")
"""Keys of a joint's drive."""

_AXES: tuple[Axis, ...] = ("x", "y", "z")


def read_joints(
    section: Section, supply: HydraulicSupply | None
) -> tuple[dict[str, Joint], dict[str, Cylinder], dict[str, HydraulicMotor]]:
    """Read `joints`: all joints, each after the one that moves its parent, and their drives."""
    joints: dict[str, Joint] = {}
    cylinders: dict[str, Cylinder] = {}
    motors: dict[str, HydraulicMotor] = {}
    links = [BASE]
    for name in section.names():
        joint = section.section(name)
        parent, child = joint.text("parent"), joint.text("child")
        if parent not in links or child in links:
            raise MachineError(
                f"joints.{name} connects {parent!r} to {child!r}; give one of {', '.join(links)}"
                " as parent, and as child a link that no earlier joint moves"
            )
        links.append(child)
        axis, origin = _read_axis(name, joint), joint.vec3("origin")
        lower, upper = joint.number_or("lower", -math.inf), joint.number_or("upper", math.inf)
        _check_range(name, lower, upper)
        drives = [drive for drive in _DRIVES if joint.has(drive)]
        if len(drives) != 1:
            raise MachineError(
                f"joints.{name} needs one drive; give one of `cylinder`, `motor` (hydraulic) and"
                " `max_effort` (any other motor)"
            )
        (drive,) = drives
        if drive != "max_effort" and supply is None:
            raise MachineError(f"joints.{name}.{drive} needs a hydraulic supply; add `hydraulics`")
        if drive == "cylinder":
            assert supply is not None
            _check_cylinder_joint(name, lower, axis, origin)
            pin = (origin[0], origin[2])
            cylinder = read_cylinder(name, joint.section("cylinder"), pin, lower, upper, supply)
            cylinders[name] = cylinder
            max_effort = max_joint_torque(cylinder, supply)
        elif drive == "motor":
            assert supply is not None
            motors[name] = read_motor(name, joint.section("motor"), supply)
            max_effort = motors[name].max_torque(supply.return_pressure)
        else:
            max_effort = joint.number("max_effort", positive=True)
        max_velocity = joint.number("max_velocity", positive=True)
        max_acceleration = joint.number("max_acceleration", positive=True)
        # Cushions at the ends of a stroke may brake harder than a valve that closes.
        end_deceleration = (
            joint.number("end_deceleration", low=max_acceleration)
            if joint.has("end_deceleration")
            else max_acceleration
        )
        joints[name] = Joint(
            lower,
            upper,
            max_effort,
            max_velocity,
            max_acceleration,
            end_deceleration,
            parent,
            child,
            origin,
            axis,
        )
        joint.reject_unknown_keys()
    return joints, cylinders, motors


def read_home(section: Section, joints: Mapping[str, Joint]) -> NDArray[np.float64]:
    """Read `home`: the initial angle of each joint [rad], shape (joints,), read-only."""
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


def read_main_body(file: Section, joints: Mapping[str, Joint]) -> str:
    """Read `main_body`: the base, or a link that rotates about the base's z axis."""
    main_body = file.text("main_body")
    rotating = [
        joint.child
        for joint in joints.values()
        if joint.parent == BASE and joint.axis == "z" and joint.origin[:2] == (0.0, 0.0)
    ]
    if main_body not in (BASE, *rotating):
        raise MachineError(
            f"main_body is {main_body!r}; give one of {', '.join([BASE, *rotating])}: the base, or"
            " a link that rotates about the base's z axis"
        )
    return main_body


def read_joystick_axes(
    section: Section, joints: Mapping[str, Joint]
) -> dict[str, tuple[str, float]]:
    """Read `joystick_axes`: axis and direction (1.0 or -1.0), by the joint that they move."""
    joystick_axes = {}
    for name in section.names():
        entry = section.section(name)
        axis, direction = entry.text("axis"), entry.number("direction")
        if name not in joints or axis not in _JOYSTICK_AXES or direction == 0.0:
            raise MachineError(
                f"joystick_axes.{name}: give a joint ({', '.join(joints)}), an axis"
                f" ({', '.join(_JOYSTICK_AXES)}) and a direction of 1 or -1"
            )
        joystick_axes[name] = (axis, math.copysign(1.0, direction))
        entry.reject_unknown_keys()
    return joystick_axes


def _read_axis(name: str, section: Section) -> Axis:
    axis = section.text("axis")
    for known in _AXES:
        if axis == known:
            return known
    raise MachineError(f"joints.{name}.axis is {axis!r}; give one of {', '.join(_AXES)}")


def _check_range(name: str, lower: float, upper: float) -> None:
    """Check the angle limits of a joint [rad]; both are infinite for a continuous joint."""
    if math.isinf(lower) != math.isinf(upper):
        raise MachineError(
            f"joints.{name} has one limit; give both [rad], or null for both of a continuous joint"
        )
    if lower >= upper:
        raise MachineError(
            f"joints.{name}.lower is {lower} and upper is {upper};"
            " give a lower limit below the upper one"
        )


def _check_cylinder_joint(name: str, lower: float, axis: Axis, origin: Vec3) -> None:
    """Check that a cylinder can drive a joint with these values."""
    if math.isinf(lower) or axis != "y" or origin[1] != 0.0:
        raise MachineError(
            f"joints.{name}.cylinder needs a joint with limits, axis y and origin [x, 0.0, z];"
            " change those, or give `max_effort` instead of a cylinder"
        )
