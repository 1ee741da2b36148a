"""Bodies of the tracks: frames and rollers on the base, sprockets, idlers and shoes."""

from __future__ import annotations

import math

import numpy as np

from machine_sim.machine.shapes.solid import Solid
from machine_sim.machine.shapes.solids import box, cylinder, extrusion
from machine_sim.machine.spec import TrackSpec

__all__ = ["idler_solids", "shoe_solids", "sprocket_solids", "track_frame_solids"]

_LINK_HEIGHT = 0.055
"""Height of the chain's links inside of the pitch line [m]."""
_SHOE_LENGTH = 0.97
"""Length of a shoe as a fraction of the pitch, so that there is a gap between shoes."""
_ROLLER_RADIUS = 0.085
_NUM_CARRIER_ROLLERS = 2
_NUM_BOLTS = 6


def sprocket_solids(tracks: TrackSpec, side: float) -> list[Solid]:
    """Return a sprocket about its axle: teeth between the links of the chain, and final drive.

    Args:
        tracks: the tracks.
        side: 1 for the left track, -1 for the right one, whose outside is at -y.
    """
    radius = tracks.sprocket_radius
    count = max(round(2.0 * math.pi * radius / tracks.pitch), 5)
    root, tip = radius - _LINK_HEIGHT - 0.005, radius + 0.004
    outline = []
    for k in range(count):
        for fraction, r in ((-0.30, root), (-0.12, tip), (0.12, tip), (0.30, root)):
            angle = 2.0 * math.pi * (k + fraction) / count
            outline.append((r * math.sin(angle), r * math.cos(angle)))
    width = 0.11
    solids = [
        Solid("worn_steel", extrusion(outline, width)),
        Solid("frame_paint", cylinder(0.62 * radius, 0.10, bevel=0.03, sides=14).shifted(y=0.085)),
        Solid("frame_paint", cylinder(0.34 * radius, 0.08, sides=12).shifted(y=0.155)),
        Solid("frame_paint", cylinder(0.55 * radius, 0.30, sides=8).shifted(y=-0.18)),
    ]
    for k in range(_NUM_BOLTS):
        angle = 2.0 * math.pi * k / _NUM_BOLTS
        x, z = 0.48 * radius * math.cos(angle), 0.48 * radius * math.sin(angle)
        solids.append(Solid("steel", cylinder(0.018, 0.02, sides=5).shifted(x, 0.143, z)))
    return _on_side(solids, side)


def idler_solids(tracks: TrackSpec, side: float) -> list[Solid]:
    """Return an idler about its axle: a wheel with a flange between the links of the chain.

    Args:
        tracks: the tracks.
        side: 1 for the left track, -1 for the right one, whose outside is at -y.
    """
    radius = tracks.sprocket_radius - _LINK_HEIGHT - 0.004
    return _on_side(
        [
            Solid("frame_paint", cylinder(radius, 0.16, sides=16)),
            Solid("worn_steel", cylinder(radius + 0.03, 0.06, sides=16)),
            Solid("frame_paint", cylinder(0.60 * radius, 0.20, end_radius=0.55 * radius, sides=12)),
            Solid("steel", cylinder(0.22 * radius, 0.27, sides=10)),
        ],
        side,
    )


def _on_side(solids: list[Solid], side: float) -> list[Solid]:
    """Return bodies as they are for the left side, mirrored for the right one."""
    return solids if side > 0.0 else [Solid(each.material, each.mesh.mirrored()) for each in solids]


def track_frame_solids(tracks: TrackSpec) -> list[Solid]:
    """Return frames and rollers of both tracks, base frame."""
    solids = []
    for side in (1.0, -1.0):
        y = 0.5 * side * tracks.gauge
        solids += [
            Solid(solid.material, solid.mesh.shifted(y=y)) for solid in _track_frame(tracks, side)
        ]
    return solids


def shoe_solids(tracks: TrackSpec) -> list[Solid]:
    """Return a shoe with grousers and the two links of the chain on it.

    The frame is that of `Tracks.shoe_poses`: the origin on the pitch line, x in the direction of
    motion when driving forward, z out of the track.
    """
    half, width, pitch = 0.5 * tracks.shoe_thickness, tracks.shoe_width, tracks.pitch
    length = _SHOE_LENGTH * pitch
    plate = 0.35 * tracks.shoe_thickness
    low = half - 2.0 * plate
    section: list[tuple[float, float]] = [(-0.5 * length, low), (0.5 * length, low)]
    for fraction in (0.47, 0.02, -0.43):
        x, top, foot = fraction * length, half, low + plate
        section += [(x + 0.022, foot), (x + 0.010, top), (x - 0.010, top), (x - 0.022, foot)]
    section[2] = (0.5 * length, low + plate)
    section.append((-0.5 * length, low + plate))
    solids = [Solid("worn_steel", extrusion(section, width, bevel=0.0))]
    for side in (1.0, -1.0):
        link = box((0.92 * pitch, 0.045, _LINK_HEIGHT + low), 0.012)
        at = 0.5 * (low - _LINK_HEIGHT)
        solids.append(Solid("frame_paint", link.shifted(y=side * 0.085, z=at)))
    return solids


def _track_frame(tracks: TrackSpec, side: float) -> list[Solid]:
    """Return the frame and the rollers of one track about its middle plane."""
    half, z, radius = 0.5 * tracks.axle_distance, tracks.axle_height, tracks.sprocket_radius
    rail = tracks.axle_height - radius + _LINK_HEIGHT  # inside of the lower run
    center = rail + _ROLLER_RADIUS
    first, last = -half + radius + 0.02, half - radius + 0.03
    low, width = center + 0.02, 0.50 * tracks.shoe_width
    body = [
        [first, low, 0.02], [last, low, 0.02], [last, z + 0.08, 0.04], [last - 0.45, z + 0.16, 0.1],
        [first + 0.30, z + 0.16, 0.1], [first, z + 0.10, 0.04],
    ]  # fmt: skip
    solids = [Solid("frame_paint", extrusion(body, width, bevel=0.02))]
    yoke = box((radius + 0.14, 0.035, 0.14), 0.012)
    solids += [
        Solid("frame_paint", yoke.shifted(half - 0.5 * radius + 0.02, end * 0.118, z))
        for end in (1.0, -1.0)
    ]
    motor = box((radius + 0.20, 0.05, 0.26), 0.015)
    solids.append(Solid("frame_paint", motor.shifted(-half + 0.5 * radius, -0.12 * side, z)))
    count = max(round((last - first) / 0.36), 3)
    for x in np.linspace(first - 0.10, last - 0.02, count).tolist():
        roller = cylinder(_ROLLER_RADIUS, 0.28, sides=8)
        solids.append(Solid("worn_steel", roller.shifted(x, 0.0, center)))
    top = z + radius - _LINK_HEIGHT
    for x in np.linspace(-0.32 * half, 0.36 * half, _NUM_CARRIER_ROLLERS).tolist():
        roller = cylinder(0.06, 0.22, sides=8)
        bracket = box((0.09, 0.08, top - z - 0.06))
        solids.append(Solid("worn_steel", roller.shifted(x, 0.0, top - 0.06)))
        solids.append(
            Solid("frame_paint", bracket.shifted(x, -side * 0.11, 0.5 * (top + z) - 0.02))
        )
    return solids
