"""Bodies of a transverse cutting drum: two tapered halves with helical rows of picks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.shapes.solid import Solid
from machine_sim.machine.shapes.solids import box, cylinder, revolution, tube
from machine_sim.machine.shapes.triangle_mesh import TriangleMesh
from machine_sim.machine.tools.drum import DrumShape

__all__ = ["drum_solids"]

Array = NDArray[np.float64]

_GAP = 0.12
"""Width between the halves as a fraction of the drum's, where the gearbox drives them."""
_END_TAPER = 0.84
"""Radius of a half's outer end as a fraction of its inner one's."""
_PICK_SPACING = 0.095
"""Approximate distance of picks along the axis [m]."""
_HELIX_TURN = 0.55 * math.pi
"""Angle by which a row of picks turns from the middle to the end [rad]."""


def drum_solids(drum: DrumShape) -> list[Solid]:
    """Return the bodies of a drum in its frame; the tips of the picks are on its radius."""
    half, gap = 0.5 * drum.width, 0.5 * _GAP * drum.width
    hub = cylinder(0.62 * drum.body_radius, 2.0 * gap + 0.02, sides=20)
    solids = [Solid("steel", hub.moved(np.eye(3), (0.0, drum.offset, 0.0)))]
    body = drum.body_radius
    contour = [
        (0.0, gap), (0.90 * body, gap), (body, gap + 0.05), (0.97 * body, 0.55 * half),
        (_END_TAPER * body, half - 0.03), (_END_TAPER * body - 0.03, half),
        (0.45 * body, half), (0.40 * body, half - 0.05), (0.0, half - 0.05),
    ]  # fmt: skip
    for side in (1.0, -1.0):
        shell = revolution(contour, sides=24)
        solids.append(Solid("frame_paint", _placed(shell, side, drum.offset)))
        for vane in range(drum.vanes):
            solids += [
                Solid(solid.material, _placed(solid.mesh, side, drum.offset))
                for solid in _row_of_picks(drum, 2.0 * math.pi * vane / drum.vanes)
            ]
    return solids


def _placed(mesh: TriangleMesh, side: float, offset: float) -> TriangleMesh:
    moved = mesh if side > 0.0 else mesh.mirrored()
    return moved.moved(np.eye(3), (0.0, offset, 0.0))


def _row_of_picks(drum: DrumShape, start: float) -> list[Solid]:
    """Return a helical ridge on the half at +y and the picks on it."""
    first, last = 0.5 * _GAP * drum.width + 0.05, 0.5 * drum.width - 0.03
    count = max(round((last - first) / _PICK_SPACING) + 1, 2)
    along = np.linspace(first, last, count)
    fraction = (along - first) / (last - first)
    angle = start + _HELIX_TURN * fraction
    surface = drum.body_radius * (1.0 - (1.0 - _END_TAPER) * fraction**2)
    ridge = np.column_stack([surface * np.cos(angle), along, -surface * np.sin(angle)])
    solids = [Solid("frame_paint", tube(ridge, 0.035, sides=6))]
    for y, turn, radius in zip(along.tolist(), angle.tolist(), surface.tolist(), strict=True):
        solids += _pick(radius, drum.radius, y, turn)
    return solids


def _pick(surface: float, tip_radius: float, y: float, angle: float) -> list[Solid]:
    """Return holder and pick at an angle from x toward -z; the tip points against the cut."""
    outward = np.array([math.cos(angle), 0.0, -math.sin(angle)])
    # A positive rotation about +y moves +x toward -z: in the direction of increasing angle.
    ahead = np.array([-math.sin(angle), 0.0, -math.cos(angle)])
    left = np.cross(ahead, outward)
    frame = np.column_stack([outward, left, ahead])
    tip = tip_radius * outward + 0.045 * ahead
    tip *= tip_radius / float(np.linalg.norm(tip))
    foot = (surface - 0.01) * outward - 0.05 * ahead
    at = np.array([0.0, y, 0.0])
    holder = box((0.07, 0.075, 0.10))
    return [
        Solid("dark_paint", holder.moved(frame, surface * outward - 0.03 * ahead + at)),
        Solid("worn_steel", tube([foot + at, tip + at], 0.038, sides=6, end_radius=0.010)),
    ]
