"""Bodies of hydraulic cylinders, rockers and couplers, in the frames of `cylinder_visuals`."""

from __future__ import annotations

import math

from machine_sim.machine.cylinder_visuals import CylinderPart
from machine_sim.machine.hydraulic_cylinder import Cylinder
from machine_sim.machine.shapes.solid import Solid
from machine_sim.machine.shapes.solids import box, cylinder, extrusion, revolution
from machine_sim.machine.shapes.triangle_mesh import TriangleMesh

__all__ = ["cylinder_solids"]

_WALL = 0.125
"""Thickness of a barrel's wall as a fraction of the bore."""

_SIDES = 12
"""Number of flats of barrels and rods."""


def cylinder_solids(part: CylinderPart, actuator: Cylinder) -> list[Solid]:
    """Return the bodies of one part.

    Args:
        part: the part.
        actuator: cylinder that it belongs to.
    """
    length = part.box.size[0]
    if part.kind == "barrel":
        return _barrel(actuator, length)
    if part.kind == "rod":
        return _rod(actuator, length)
    if part.kind == "rocker":
        # Two plates on the outside of the arm.
        offset = 0.5 * part.box.size[1] + 0.035
        plates = [_bar(length, 0.105, 0.035, y) for y in (offset, -offset)]
        pin = cylinder(0.045, 2.0 * offset + 0.06, axis="y", sides=10)
        return [
            *(Solid("frame_paint", plate) for plate in plates),
            Solid("steel", pin),
            Solid("steel", pin.shifted(length)),
        ]
    # Two plates between those of the rocker, on both sides of the rod's eye.
    offset = 0.5 * part.box.size[1] + 0.025
    return [
        Solid("frame_paint", _bar(length, 0.09, 0.045, y, waist=0.06)) for y in (offset, -offset)
    ]


def _barrel(actuator: Cylinder, length: float) -> list[Solid]:
    """Return tube, head, eye and port block of a barrel; it points to +x from its pin."""
    radius = (0.5 + _WALL) * actuator.bore
    head, eye = 1.14 * radius, 0.9 * radius
    contour = [
        (0.0, 0.6 * eye), (radius, 0.6 * eye), (radius, length - 0.12), (head, length - 0.11),
        (head, length - 0.012), (head - 0.012, length), (0.0, length),
    ]  # fmt: skip
    port = box((0.10, 0.07, 0.05))
    line = box((0.62 * length, 0.03, 0.03))
    return [
        Solid("paint", revolution(contour, axis="x", sides=_SIDES)),
        Solid("paint", _eye(eye, 1.5 * actuator.bore)),
        Solid("dark_paint", port.shifted(1.4 * eye, z=radius + 0.012)),
        Solid("dark_paint", port.shifted(length - 0.12, z=head + 0.012)),
        Solid("dark_paint", line.shifted(1.4 * eye + 0.31 * length, z=radius + 0.02)),
    ]


def _rod(actuator: Cylinder, length: float) -> list[Solid]:
    """Return bar and eye of a rod; it points to -x from its pin."""
    radius = 0.5 * actuator.rod_diameter
    eye = 0.58 * actuator.rod_diameter
    width = 1.35 * actuator.bore
    bar = cylinder(radius, length, axis="x", sides=_SIDES)
    collar = cylinder(1.25 * radius, 0.12, axis="x", sides=_SIDES)
    return [
        Solid("chrome", bar.shifted(-0.5 * length)),
        Solid("paint", collar.shifted(-0.05 - 0.75 * eye)),
        Solid("paint", _eye(eye, width)),
    ]


def _eye(radius: float, width: float) -> TriangleMesh:
    return cylinder(radius, width, axis="y", sides=10)


def _bar(
    length: float, radius: float, width: float, y: float, waist: float | None = None
) -> TriangleMesh:
    """Return a plate in the xz plane with a rounded eye at both ends, pin to pin along x."""
    half = radius if waist is None else waist
    steps = [math.radians(angle) for angle in range(-60, 61, 40)]
    front = [(length + radius * math.cos(a), radius * math.sin(a)) for a in steps]
    back = [(-radius * math.cos(a), -radius * math.sin(a)) for a in steps]
    middle = [(0.7 * length, 0.85 * half), (0.3 * length, 0.85 * half)]
    below = [(x, -z) for x, z in reversed(middle)]
    return extrusion([*front, *middle, *back, *below], width, position=y)
