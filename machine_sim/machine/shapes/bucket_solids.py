"""Bodies of an excavator's bucket: shell, side plates, cutting edge with teeth, mounting ears."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.shapes.curves import band, circle, convex_hull, smooth_curve, with_offset
from machine_sim.machine.shapes.solid import Solid
from machine_sim.machine.shapes.solids import cylinder, extrusion
from machine_sim.machine.tools.bucket import BucketShape

__all__ = ["bucket_solids"]

Array = NDArray[np.float64]
Point = tuple[float, float]

_CURVE_STEPS = 3
_TOOTH_SPACING = 0.27
"""Approximate distance between teeth [m]."""
_EAR_SPACING = 0.46
"""Distance between the middles of the mounting ears [m]."""
_EAR_THICKNESS = 0.05


def bucket_solids(bucket: BucketShape, pins: Sequence[Point]) -> list[Solid]:
    """Return the bodies of a bucket in its frame.

    Args:
        bucket: shape of the bucket; its shell encloses the profile from outside.
        pins: x, z [m] of pins of the linkage on the bucket, beside that at the origin.
    """
    thickness = bucket.plate_thickness
    curve = smooth_curve(bucket.profile, _CURVE_STEPS)
    outside = with_offset(curve, thickness)
    shell = extrusion(band(curve, thickness).tolist(), bucket.width + 2.0 * thickness)
    solids = [Solid("dark_paint", shell)]
    solids += _side_plates(bucket, outside)
    solids += _cutting_edge(bucket)
    solids += _wear_straps(bucket, curve)
    return [*solids, *_ears(bucket, pins)]


def _side_plates(bucket: BucketShape, outside: Array) -> list[Solid]:
    """Return the side walls, with a thicker rim along the opening."""
    thickness = bucket.plate_thickness
    lip, rim = outside[0], outside[-1]
    along = (lip - rim) / np.linalg.norm(lip - rim)
    inward = np.array([-along[1], along[0]])
    if inward @ (outside.mean(axis=0) - lip) < 0.0:
        inward = -inward
    y = 0.5 * (bucket.width + thickness)
    rim_plate = np.array([rim, lip, lip + 0.09 * inward - 0.06 * along, rim + 0.07 * inward])
    cutter = [
        lip + 0.01 * along,
        lip - 0.30 * along,
        lip - 0.26 * along + 0.13 * inward,
        lip + 0.15 * inward - 0.02 * along,
    ]
    solids = []
    for side in (1.0, -1.0):
        at = side * (y + thickness)
        solids += [
            Solid("dark_paint", extrusion(outside.tolist(), thickness, position=side * y)),
            Solid("dark_paint", extrusion(rim_plate.tolist(), 0.6 * thickness, position=at)),
            Solid(
                "worn_steel",
                extrusion(np.array(cutter).tolist(), thickness, position=at, bevel=0.004),
            ),
        ]
    return solids


def _cutting_edge(bucket: BucketShape) -> list[Solid]:
    """Return the edge plate and its teeth; the tips are ahead of the cutting lip."""
    lip, floor = bucket.profile[0], bucket.profile[1]
    ahead = (lip - floor) / np.linalg.norm(lip - floor)
    out = np.array([-ahead[1], ahead[0]])  # away from the opening
    if out @ (bucket.profile.mean(axis=0) - lip) > 0.0:
        out = -out

    def outline(points: Sequence[Point]) -> list[list[float]]:
        return [(lip + u * ahead + v * out).tolist() for u, v in points]

    t = bucket.plate_thickness
    plate = outline(
        [(-0.24, -0.006), (-0.01, -0.006), (0.0, 0.5 * t), (-0.02, t), (-0.24, 1.5 * t)]
    )
    solids = [Solid("worn_steel", extrusion(plate, bucket.width + 2.0 * t))]
    adapter = outline([(-0.16, -0.03), (0.015, -0.034), (0.055, -0.004), (0.055, t + 0.01),
                       (0.0, t + 0.035), (-0.12, t + 0.03)])  # fmt: skip
    tip = outline([(0.01, -0.024), (0.13, 0.4 * t), (0.13, 0.4 * t + 0.012), (0.01, t + 0.026)])
    count = max(round(bucket.width / _TOOTH_SPACING) + 1, 2)
    for y in np.linspace(-0.5 * bucket.width + 0.04, 0.5 * bucket.width - 0.04, count):
        solids.append(
            Solid("dark_paint", extrusion(adapter, 0.085, position=float(y), bevel=0.008))
        )
        solids.append(Solid("worn_steel", extrusion(tip, 0.068, position=float(y))))
    return solids


def _wear_straps(bucket: BucketShape, curve: Array) -> list[Solid]:
    """Return straps under floor and heel."""
    t = bucket.plate_thickness
    part = with_offset(curve, t)[_CURVE_STEPS : 4 * _CURVE_STEPS + 1]
    strap = band(part[::2], 0.02).tolist()
    return [
        Solid("worn_steel", extrusion(strap, 0.07, position=float(y)))
        for y in np.linspace(-0.33 * bucket.width, 0.33 * bucket.width, 3)
    ]


def _ears(bucket: BucketShape, pins: Sequence[Point]) -> list[Solid]:
    """Return two plates from the back of the bucket around the pins, with bosses."""
    back = bucket.profile[-3:]
    corners = [circle((0.0, 0.0), 0.10, 14), *(circle(pin, 0.09, 14) for pin in pins)]
    hull = convex_hull(np.vstack([*corners, back[[0, 2]]]))
    start = int(np.argmin(np.linalg.norm(hull - back[0], axis=1)))
    outline = np.roll(hull, -start, axis=0)
    if np.linalg.norm(outline[1] - back[2]) < 1e-9:
        outline = np.vstack([outline[:1], back[1:2], outline[1:]])
    elif np.linalg.norm(outline[-1] - back[2]) < 1e-9:
        outline = np.vstack([outline, back[1:2]])
    solids = []
    for side in (1.0, -1.0):
        y = 0.5 * side * _EAR_SPACING
        solids.append(Solid("dark_paint", extrusion(outline.tolist(), _EAR_THICKNESS, position=y)))
    for x, z in [(0.0, 0.0), *pins]:
        pin = cylinder(0.045, _EAR_SPACING + 0.16, sides=10)
        solids.append(Solid("steel", pin.moved(np.eye(3), (x, 0.0, z))))
        for side in (1.0, -1.0):
            boss = cylinder(0.085, 0.03, sides=14)
            at = (x, side * 0.5 * (_EAR_SPACING + _EAR_THICKNESS + 0.03), z)
            solids.append(Solid("dark_paint", boss.moved(np.eye(3), at)))
    return solids
