"""Visual parts of the cylinders: barrels, rods, rockers and couplers.

They have no mass and no collision shape: in the physics the cylinders are torques on the joints.
Each part is a link of the URDF with its own joint, whose value follows from the joint angles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

from machine_sim.machine.cylinder_linkage import LinkagePins, Point
from machine_sim.machine.hydraulic_cylinder import Cylinder
from machine_sim.machine.spec import Box, MachineSpec, Vec3

__all__ = [
    "CylinderJointStates",
    "CylinderPart",
    "cylinder_joint_states",
    "cylinder_joint_values",
    "cylinder_parts",
]

Rgba = tuple[float, float, float, float]

_BARREL_COLOR = (0.20, 0.20, 0.22, 1.0)
_ROD_COLOR = (0.80, 0.82, 0.85, 1.0)
_BAR_COLOR = (0.30, 0.30, 0.33, 1.0)

_BARREL_DIAMETER_RATIO = 1.25
"""Ratio of outer to inner diameter of a barrel."""
_BARREL_LENGTH_FRACTION = 0.9
"""Length of a barrel as a fraction of the retracted cylinder; the rest is the rod's eye."""
_BAR_THICKNESS = 0.12
"""Thickness of rockers and couplers as drawn [m]."""
_DIFFERENCE_TIME = 1e-4
"""Time step of the difference quotient for the velocities of the parts [s]."""


class CylinderPart(NamedTuple):
    """A visual link and the joint that moves it.

    Attributes:
        link: name of the link.
        parent: name of its parent link.
        joint: name of the joint between them.
        is_prismatic: whether the joint translates along x, or rotates about y.
        origin: origin of the joint in the parent's frame [m].
        lower, upper: range of a prismatic joint [m].
        mimic: name of the joint whose value it has, or None.
        cylinder: name of the joint that its cylinder drives.
        kind: which part of the cylinder it is.
        box: simple shape of the link.
        color: red, green, blue and alpha of the simple shape, 0 to 1.
    """

    link: str
    parent: str
    joint: str
    is_prismatic: bool
    origin: Vec3
    lower: float
    upper: float
    mimic: str | None
    cylinder: str
    kind: Literal["barrel", "rod", "rocker", "coupler"]
    box: Box
    color: Rgba


class CylinderJointStates(NamedTuple):
    """Names, positions [rad or m] and velocities [rad/s or m/s] of the joints of parts."""

    names: list[str]
    positions: list[float]
    velocities: list[float]


@lru_cache(maxsize=16)
def cylinder_parts(spec: MachineSpec) -> tuple[CylinderPart, ...]:
    """Return the parts of all cylinders, each after its parent."""
    parts: list[CylinderPart] = []
    for name, cylinder in spec.cylinders.items():
        parent = spec.joints[name].parent
        first: tuple[str, str] | None = None
        for side, y in _lateral_offsets(cylinder):
            pair = _barrel_and_rod(name, parent, cylinder, side, y, first)
            first = first or (pair[0].joint, pair[1].joint)
            parts += pair
        parts += _rocker_and_coupler(name, parent, cylinder)
    return tuple(parts)


def cylinder_joint_values(spec: MachineSpec, joints: Sequence[float]) -> list[float]:
    """Return the joint values of the parts, in the order of `cylinder_parts`.

    Args:
        spec: specification of the machine.
        joints: joint angles of the machine [rad].

    Returns:
        Angles of revolute joints [rad]; lengths from pin to pin of prismatic joints [m].
    """
    values = []
    names = spec.joint_names
    for name, cylinder in spec.cylinders.items():
        linkage = cylinder.linkage
        angle = min(max(joints[names.index(name)], linkage.lower), linkage.upper)
        pins = linkage.pins(angle)
        for _ in _lateral_offsets(cylinder):
            values += [_pitch(pins.barrel, pins.rod), math.dist(pins.barrel, pins.rod)]
        values += _rocker_and_coupler_angles(cylinder, pins)
    return values


def cylinder_joint_states(
    spec: MachineSpec, joints: Sequence[float], rates: Sequence[float]
) -> CylinderJointStates:
    """Return the joint states of the parts, except of joints that mimic another one.

    Args:
        spec: specification of the machine.
        joints, rates: joint angles [rad] and velocities [rad/s] of the machine.
    """
    now = cylinder_joint_values(spec, joints)
    later = cylinder_joint_values(
        spec, [angle + _DIFFERENCE_TIME * rate for angle, rate in zip(joints, rates, strict=True)]
    )
    parts = cylinder_parts(spec)
    independent = [k for k, part in enumerate(parts) if part.mimic is None]
    return CylinderJointStates(
        [parts[k].joint for k in independent],
        [now[k] for k in independent],
        [math.remainder(later[k] - now[k], 2.0 * math.pi) / _DIFFERENCE_TIME for k in independent],
    )


def _lateral_offsets(cylinder: Cylinder) -> list[tuple[str, float]]:
    """Return suffixes of names and lateral positions [m] of parallel cylinders."""
    if cylinder.count == 1:
        return [("", 0.0)]
    step = cylinder.spread / (cylinder.count - 1)
    names = ("_left", "_right") if cylinder.count == 2 else range(cylinder.count)
    return [
        (name if isinstance(name, str) else f"_{name}", 0.5 * cylinder.spread - k * step)
        for k, name in enumerate(names)
    ]


def _barrel_and_rod(
    name: str,
    parent: str,
    cylinder: Cylinder,
    side: str,
    y: float,
    first: tuple[str, str] | None,
) -> list[CylinderPart]:
    """Return barrel and rod of one cylinder; `first` are the joints that they mimic."""
    linkage = cylinder.linkage
    barrel, rod = f"{name}_barrel{side}", f"{name}_rod{side}"
    pin = (linkage.barrel[0], y, linkage.barrel[1])
    tube_length = _BARREL_LENGTH_FRACTION * linkage.min_length
    rod_length = (
        linkage.max_length - tube_length + 0.1
    )  # part of the rod always remains in the barrel
    thick, thin = _BARREL_DIAMETER_RATIO * cylinder.bore, cylinder.rod_diameter
    tube_box = Box((tube_length, thick, thick), (0.5 * tube_length, 0.0, 0.0), 0.0)
    rod_box = Box((rod_length, thin, thin), (-0.5 * rod_length, 0.0, 0.0), 0.0)
    mimicked_barrel, mimicked_rod = first or (None, None)
    return [
        CylinderPart(
            barrel,
            parent,
            f"{barrel}_pin",
            False,
            pin,
            0.0,
            0.0,
            mimicked_barrel,
            name,
            "barrel",
            tube_box,
            _BARREL_COLOR,
        ),
        CylinderPart(
            rod,
            barrel,
            f"{rod}_stroke",
            True,
            (0.0, 0.0, 0.0),
            linkage.min_length,
            linkage.max_length,
            mimicked_rod,
            name,
            "rod",
            rod_box,
            _ROD_COLOR,
        ),
    ]


def _rocker_and_coupler(name: str, parent: str, cylinder: Cylinder) -> list[CylinderPart]:
    """Return rocker and coupler of a joint, or nothing without a rocker."""
    rocker = cylinder.linkage.rocker
    if rocker is None:
        return []
    pin = (rocker.pin[0], 0.0, rocker.pin[1])
    end = (rocker.length, 0.0, 0.0)
    link, coupler = f"{name}_rocker", f"{name}_coupler"
    return [
        CylinderPart(
            link,
            parent,
            f"{link}_pin",
            False,
            pin,
            0.0,
            0.0,
            None,
            name,
            "rocker",
            _bar(rocker.length, 2.5 * _BAR_THICKNESS),
            _BAR_COLOR,
        ),
        CylinderPart(
            coupler,
            link,
            f"{coupler}_pin",
            False,
            end,
            0.0,
            0.0,
            None,
            name,
            "coupler",
            _bar(rocker.coupler_length, 1.5 * _BAR_THICKNESS),
            _BAR_COLOR,
        ),
    ]


def _bar(length: float, width: float) -> Box:
    return Box((length, width, _BAR_THICKNESS), (0.5 * length, 0.0, 0.0), 0.0)


def _rocker_and_coupler_angles(cylinder: Cylinder, pins: LinkagePins) -> list[float]:
    rocker = cylinder.linkage.rocker
    if rocker is None or pins.coupler_pin is None:
        return []
    angle = _pitch(rocker.pin, pins.rod)
    return [angle, math.remainder(_pitch(pins.rod, pins.coupler_pin) - angle, 2.0 * math.pi)]


def _pitch(a: Point, b: Point) -> float:
    """Return the rotation about +y from x to the direction from a to b [rad]."""
    return math.atan2(a[1] - b[1], b[0] - a[0])
