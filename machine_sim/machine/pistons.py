"""What is seen of the cylinders: barrels, rods, rockers and couplers as links that follow the arm.

They weigh nothing and touch nothing: the physics knows only what they do to the joints. Each is a
link of the URDF with a joint of its own, whose value follows from the arm's angles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from machine_sim.machine.description import Box, MachineDescription, Vec3
from machine_sim.machine.hydraulics import Cylinder
from machine_sim.machine.linkage import LinkagePins, Point

__all__ = ["PistonJoints", "PistonPart", "piston_joints", "piston_parts", "piston_values"]

_BARREL = "0.20 0.20 0.22 1"
_ROD = "0.80 0.82 0.85 1"
_BAR = "0.30 0.30 0.33 1"

_WALL = 1.25
"""Outer over inner diameter of a barrel."""
_GLAND = 0.9
"""Length of a barrel in parts of the shortest cylinder: the rest is the rod's eye."""
_THICK = 0.12
"""Rockers and couplers as drawn [m]."""
_MOMENT = 1e-4
"""Time over which the speeds of the parts are taken [s]."""


class PistonPart(NamedTuple):
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
    slides: bool
    origin: Vec3
    lower: float
    upper: float
    mimics: str | None
    box: Box
    color: str


class PistonJoints(NamedTuple):
    """Names, values [rad or m] and speeds [rad/s or m/s] of the parts' joints."""

    names: list[str]
    positions: list[float]
    velocities: list[float]


@lru_cache(maxsize=16)
def piston_parts(description: MachineDescription) -> tuple[PistonPart, ...]:
    """The parts of all cylinders, each after the one that it hangs on."""
    parts: list[PistonPart] = []
    for name, cylinder in description.cylinders.items():
        parent = description.joints[name].parent
        first: tuple[str, str] | None = None
        for side, y in _across(cylinder):
            pair = _cylinder_parts(name, parent, cylinder, side, y, first)
            first = first or (pair[0].joint, pair[1].joint)
            parts += pair
        parts += _bars(name, parent, cylinder)
    return tuple(parts)


def piston_values(description: MachineDescription, joints: Sequence[float]) -> list[float]:
    """Joint values of the parts, in the order of `piston_parts`.

    Args:
        description: the machine.
        joints: angles of its joints [rad].

    Returns:
        Angles [rad] and, of the joints that slide, lengths from pin to pin [m].
    """
    values = []
    names = description.joint_names
    for name, cylinder in description.cylinders.items():
        linkage = cylinder.linkage
        angle = min(max(joints[names.index(name)], linkage.lower), linkage.upper)
        pins = linkage.pins(angle)
        for _ in _across(cylinder):
            values += [_pitch(pins.barrel, pins.rod), math.dist(pins.barrel, pins.rod)]
        values += _bar_angles(cylinder, pins)
    return values


def piston_joints(
    description: MachineDescription, joints: Sequence[float], rates: Sequence[float]
) -> PistonJoints:
    """The state of the joints of the parts, without those that mimic another.

    Args:
        description: the machine.
        joints, rates: of its joints [rad], [rad/s].
    """
    now = piston_values(description, joints)
    soon = piston_values(
        description, [angle + _MOMENT * rate for angle, rate in zip(joints, rates, strict=True)]
    )
    own = [k for k, part in enumerate(piston_parts(description)) if part.mimics is None]
    return PistonJoints(
        [piston_parts(description)[k].joint for k in own],
        [now[k] for k in own],
        [math.remainder(soon[k] - now[k], 2.0 * math.pi) / _MOMENT for k in own],
    )


def _across(cylinder: Cylinder) -> list[tuple[str, float]]:
    """Names and places across the machine [m] of cylinders side by side."""
    if cylinder.count == 1:
        return [("", 0.0)]
    step = cylinder.spread / (cylinder.count - 1)
    names = ("_left", "_right") if cylinder.count == 2 else range(cylinder.count)
    return [
        (name if isinstance(name, str) else f"_{name}", 0.5 * cylinder.spread - k * step)
        for k, name in enumerate(names)
    ]


def _cylinder_parts(
    name: str,
    parent: str,
    cylinder: Cylinder,
    side: str,
    y: float,
    first: tuple[str, str] | None,
) -> list[PistonPart]:
    linkage = cylinder.linkage
    barrel, rod = f"{name}_barrel{side}", f"{name}_rod{side}"
    pin = (linkage.barrel[0], y, linkage.barrel[1])
    tube = _GLAND * linkage.shortest
    reach = linkage.longest - tube + 0.1  # what is drawn of the rod, a bit of it always inside
    thick, thin = _WALL * cylinder.bore, cylinder.rod_diameter
    tube_box = Box((tube, thick, thick), (0.5 * tube, 0.0, 0.0), 0.0)
    rod_box = Box((reach, thin, thin), (-0.5 * reach, 0.0, 0.0), 0.0)
    turn, slide = first or (None, None)
    return [
        PistonPart(
            barrel, parent, f"{barrel}_pin", False, pin, 0.0, 0.0, turn, tube_box, _BARREL
        ),
        PistonPart(
            rod, barrel, f"{rod}_stroke", True, (0.0, 0.0, 0.0), linkage.shortest, linkage.longest,
            slide, rod_box, _ROD,
        ),
    ]  # fmt: skip


def _bars(name: str, parent: str, cylinder: Cylinder) -> list[PistonPart]:
    rocker = cylinder.linkage.rocker
    if rocker is None:
        return []
    pin = (rocker.pin[0], 0.0, rocker.pin[1])
    end = (rocker.length, 0.0, 0.0)
    link, coupler = f"{name}_rocker", f"{name}_coupler"
    return [
        PistonPart(
            link, parent, f"{link}_pin", False, pin, 0.0, 0.0, None,
            _bar(rocker.length, 2.5 * _THICK), _BAR,
        ),
        PistonPart(
            coupler, link, f"{coupler}_pin", False, end, 0.0, 0.0, None,
            _bar(rocker.coupler, 1.5 * _THICK), _BAR,
        ),
    ]  # fmt: skip


def _bar(length: float, wide: float) -> Box:
    return Box((length, wide, _THICK), (0.5 * length, 0.0, 0.0), 0.0)


def _bar_angles(cylinder: Cylinder, pins: LinkagePins) -> list[float]:
    rocker = cylinder.linkage.rocker
    if rocker is None or pins.ear is None:
        return []
    turn = _pitch(rocker.pin, pins.rod)
    return [turn, math.remainder(_pitch(pins.rod, pins.ear) - turn, 2.0 * math.pi)]


def _pitch(a: Point, b: Point) -> float:
    """Turn about +y that carries x to the way from a to b [rad]."""
    return math.atan2(a[1] - b[1], b[0] - a[0])
