"""Bodies of a tipping bed: floor and front wall, side walls with ribs and rails, beams below."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.shapes.curves import band, with_offset
from machine_sim.machine.shapes.solid import Solid
from machine_sim.machine.shapes.solids import box, cylinder, extrusion
from machine_sim.machine.tools.bed import BedShape

__all__ = ["bed_solids"]

Array = NDArray[np.float64]

_RIB_SPACING = 0.62
"""Approximate distance between the ribs of a side wall [m]."""
_RAIL = 0.12
"""Edge of the rails on the rims [m]."""


def bed_solids(bed: BedShape) -> list[Solid]:
    """Return the bodies of a bed in its frame; its plates enclose the profile from outside."""
    t, half = bed.plate_thickness, 0.5 * bed.width
    outside = with_offset(bed.profile, t)
    plate = extrusion(band(bed.profile, t).tolist(), bed.width + 2.0 * t)
    solids = [Solid("paint", plate)]
    for side in (1.0, -1.0):
        y = side * (half + 0.5 * t)
        solids.append(Solid("paint", extrusion(outside.tolist(), t, position=y)))
        solids += _ribs(bed, outside, side)
        solids.append(_rail(bed, side))
    solids += _end_rails(bed)
    return [*solids, *_beams(bed)]


def _top(bed: BedShape, x: float) -> float:
    """Return the height of the opening at x [m]."""
    (x0, z0), (x1, z1) = bed.profile[0], bed.profile[-1]
    return float(z0 + (z1 - z0) * (x - x0) / (x1 - x0))


def _bottom(outside: Array, x: float) -> float:
    return float(np.interp(x, outside[:-1, 0], outside[:-1, 1]))


def _ribs(bed: BedShape, outside: Array, side: float) -> list[Solid]:
    first, last = outside[1, 0] + 0.08, outside[-2, 0] - 0.10
    count = max(round((last - first) / _RIB_SPACING) + 1, 2)
    y = side * (0.5 * bed.width + bed.plate_thickness + 0.045)
    solids = []
    for x in np.linspace(first, last, count).tolist():
        low, high = _bottom(outside, x) - 0.02, _top(bed, x) - 0.04
        rib = box((0.11, 0.09, max(high - low, 0.05)), 0.018)
        solids.append(Solid("paint", rib.moved(np.eye(3), (x, y, 0.5 * (low + high)))))
    return solids


def _rail(bed: BedShape, side: float) -> Solid:
    (x0, z0), (x1, z1) = bed.profile[0], bed.profile[-1]
    y = side * (0.5 * bed.width + bed.plate_thickness + 0.5 * _RAIL - 0.02)
    corners = [[x0, z0 - _RAIL], [x1 + 0.04, z1 - _RAIL], [x1 + 0.04, z1 + 0.015], [x0, z0 + 0.015]]
    return Solid("paint", extrusion(corners, _RAIL, position=y, bevel=0.018))


def _end_rails(bed: BedShape) -> list[Solid]:
    """Return the rail on the front wall, and the lip at the rear."""
    (x1, z1), t = bed.profile[-1], bed.plate_thickness
    front = box((_RAIL, bed.width + 2.0 * t + 2.0 * _RAIL - 0.04, _RAIL + 0.015), 0.018)
    solids = [Solid("paint", front.moved(np.eye(3), (x1 + t + 0.5 * _RAIL - 0.02, 0.0, z1 - 0.05)))]
    low, high = bed.profile[-2], bed.profile[-1]
    for y in np.linspace(-0.36 * bed.width, 0.36 * bed.width, 4).tolist():
        rib = [
            [low[0] + t, low[1] - 0.02], [low[0] + t + 0.08, low[1] + 0.02],
            [high[0] + t + 0.08, high[1] - 0.06], [high[0] + t, high[1] - 0.06],
        ]  # fmt: skip
        solids.append(Solid("paint", extrusion(rib, 0.10, position=y, bevel=0.014)))
    rear = bed.profile[0]
    lip = box((0.06, bed.width + 2.0 * t, 0.05), 0.012)
    return [*solids, Solid("worn_steel", lip.moved(np.eye(3), (rear[0], 0.0, rear[1] - 0.025)))]


def _beams(bed: BedShape) -> list[Solid]:
    """Return two beams along the floor and the tube of the hinge at the origin."""
    z = float(bed.profile[1:-1, 1].min()) - bed.plate_thickness
    x0, x1 = float(bed.profile[1, 0]), float(bed.profile[-2, 0])
    beam = [[-0.09, -0.05], [0.10, -0.06], [x1 - 0.35, z - 0.09], [x1, z - 0.04], [x1, z + 0.01],
            [x0 - 0.1, z + 0.02], [-0.11, 0.05]]  # fmt: skip
    solids = [
        Solid("dark_paint", extrusion(beam, 0.10, position=side * 0.36, bevel=0.012))
        for side in (1.0, -1.0)
    ]
    hinge = cylinder(0.075, 1.02, bevel=0.01, sides=16)
    return [*solids, Solid("steel", hinge)]
