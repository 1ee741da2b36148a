"""What is seen of the cylinders: barrels, rods, rockers and couplers as links that follow the arm.

They weigh nothing and touch nothing: the physics knows only what they do to the joints. Each is a
link of the URDF with a joint of its own, whose value follows from the arm's angles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from machine_sim.machine.cylinder_linkage import LinkagePins, Point
from machine_sim.machine.hydraulics import Cylinder
from machine_sim.machine.spec import Box, MachineSpec, Vec3

__all__ = [
    "CylinderJointStates",
    "CylinderPart",
    "cylinder_joint_states",
    "cylinder_joint_values",
    "cylinder_parts",
]

_BARREL_COLOR = "0.20 0.20 0.22 1"
_ROD_COLOR = "0.80 0.82 0.85 1"
_BAR_COLOR = "0.30 0.30 0.33 1"

_BARREL_DIAMETER_RATIO = 1.25
"""Outer over inner diameter of a barrel."""
_BARREL_LENGTH_FRACTION = 0.9
"""Length of a barrel in parts of the shortest cylinder: the rest is the rod's eye."""
_BAR_THICKNESS = 0.12
"""Rockers and couplers as drawn [m]."""
_DIFFERENCE_TIME = 1e-4
"""Time over which the speeds of the parts are taken [s]."""


class CylinderPart(NamedTuple):
    """A link that is seen, and the joint that moves it.

    Attributes:
        link: its name.
        parent: link that it hangs on.
        joint: name of the joint between.
        slides: whether that joint slides along x, or turns about y.
        origin: of the joint in the parent's frame [m].
        lower, upper: range of a joint that slides [m].
        mimics: name of the joint that it moves alike, or None.
        box: what is seen.
        color: r g b a.
    """

    link: str
    parent: str
    joint: str
    is_prismatic: bool
    origin: Vec3
    lower: float
    upper: float
    mimic: str | None
    box: Box
    color: str


class CylinderJointStates(NamedTuple):
    """Names, values [rad or m] and speeds [rad/s or m/s] of the parts' joints."""

    names: list[str]
    positions: list[float]
    velocities: list[float]


@lru_cache(maxsize=16)
def cylinder_parts(spec: MachineSpec) -> tuple[CylinderPart, ...]:
    """The parts of all cylinders, each after the one that it hangs on."""
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
    """Joint values of the parts, in the order of `cylinder_parts`.

    Args:
        description: the machine.
        joints: angles of its joints [rad].

    Returns:
        Angles [rad] and, of the joints that slide, lengths from pin to pin [m].
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
    """The state of the joints of the parts, without those that mimic another.

    Args:
        description: the machine.
        joints, rates: of its joints [rad], [rad/s].
    """
    now = cylinder_joint_values(spec, joints)
    soon = cylinder_joint_values(
        spec, [angle + _DIFFERENCE_TIME * rate for angle, rate in zip(joints, rates, strict=True)]
    )
    own = [k for k, part in enumerate(cylinder_parts(spec)) if part.mimic is None]
    return CylinderJointStates(
        [cylinder_parts(spec)[k].joint for k in own],
        [now[k] for k in own],
        [math.remainder(soon[k] - now[k], 2.0 * math.pi) / _DIFFERENCE_TIME for k in own],
    )


def _lateral_offsets(cylinder: Cylinder) -> list[tuple[str, float]]:
    """Names and places across the machine [m] of cylinders side by side."""
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
    linkage = cylinder.linkage
    barrel, rod = f"{name}_barrel{side}", f"{name}_rod{side}"
    pin = (linkage.barrel[0], y, linkage.barrel[1])
    tube = _BARREL_LENGTH_FRACTION * linkage.min_length
    reach = linkage.max_length - tube + 0.1  # what is drawn of the rod, a bit of it always inside
    thick, thin = _BARREL_DIAMETER_RATIO * cylinder.bore, cylinder.rod_diameter
    tube_box = Box((tube, thick, thick), (0.5 * tube, 0.0, 0.0), 0.0)
    rod_box = Box((reach, thin, thin), (-0.5 * reach, 0.0, 0.0), 0.0)
    turn, slide = first or (None, None)
    return [
        CylinderPart(
            barrel, parent, f"{barrel}_pin", False, pin, 0.0, 0.0, turn, tube_box, _BARREL_COLOR
        ),
        CylinderPart(
            rod, barrel, f"{rod}_stroke", True, (0.0, 0.0, 0.0), linkage.min_length, linkage.max_length,
            slide, rod_box, _ROD_COLOR,
        ),
    ]  # fmt: skip


def _rocker_and_coupler(name: str, parent: str, cylinder: Cylinder) -> list[CylinderPart]:
    rocker = cylinder.linkage.rocker
    if rocker is None:
        return []
    pin = (rocker.pin[0], 0.0, rocker.pin[1])
    end = (rocker.length, 0.0, 0.0)
    link, coupler = f"{name}_rocker", f"{name}_coupler"
    return [
        CylinderPart(
            link, parent, f"{link}_pin", False, pin, 0.0, 0.0, None,
            _bar(rocker.length, 2.5 * _BAR_THICKNESS), _BAR_COLOR,
        ),
        CylinderPart(
            coupler, link, f"{coupler}_pin", False, end, 0.0, 0.0, None,
            _bar(rocker.coupler_length, 1.5 * _BAR_THICKNESS), _BAR_COLOR,
        ),
    ]  # fmt: skip


def _bar(length: float, wide: float) -> Box:
    return Box((length, wide, _BAR_THICKNESS), (0.5 * length, 0.0, 0.0), 0.0)


def _rocker_and_coupler_angles(cylinder: Cylinder, pins: LinkagePins) -> list[float]:
    rocker = cylinder.linkage.rocker
    if rocker is None or pins.coupler_pin is None:
        return []
    turn = _pitch(rocker.pin, pins.rod)
    return [turn, math.remainder(_pitch(pins.rod, pins.coupler_pin) - turn, 2.0 * math.pi)]


def _pitch(a: Point, b: Point) -> float:
    """Turn about +y that carries x to the way from a to b [rad]."""
    return math.atan2(a[1] - b[1], b[0] - a[0])
