"""Simple visual shapes of a machine for markers: boxes of its links, shoes of the tracks."""

from __future__ import annotations

from typing import NamedTuple

from machine_sim.machine.cylinder_visuals import cylinder_parts
from machine_sim.machine.spec import MachineSpec, Vec3
from machine_sim.machine.urdf import collision_boxes, link_frame

__all__ = ["ShoeVisual", "VisualBox", "marker_boxes", "shoe_visual"]

Rgba = tuple[float, float, float, float]

_SHOE_COLOR = (0.33, 0.35, 0.36, 1.0)

_SHOE_LENGTH = 0.96
"""Length of a drawn shoe as a fraction of the pitch, so that there is a gap between shoes."""


class VisualBox(NamedTuple):
    """A box of a link.

    Attributes:
        link: name of the frame that it is in.
        size, center, pitch: as in `Box`.
        color: red, green, blue, alpha, 0 to 1.
    """

    link: str
    size: Vec3
    center: Vec3
    pitch: float
    color: Rgba


class ShoeVisual(NamedTuple):
    """Shoes of both tracks.

    Attributes:
        shoe_size: length, width and thickness of a shoe [m].
        shoe_count: number of shoes of one track.
        gauge: distance between the middles of the tracks [m].
        color: red, green, blue, alpha, 0 to 1.
    """

    shoe_size: Vec3
    shoe_count: int
    gauge: float
    color: Rgba


def marker_boxes(spec: MachineSpec) -> list[VisualBox]:
    """Return the boxes of all links with their tools, then of the cylinder parts."""
    boxes = [
        VisualBox(link_frame(name), box.size, box.center, box.pitch, (*link.color, 1.0))
        for name, link in spec.links.items()
        for box in collision_boxes(spec, name)
    ]
    boxes += [
        VisualBox(part.link, part.box.size, part.box.center, part.box.pitch, part.color)
        for part in cylinder_parts(spec)
    ]
    return boxes


def shoe_visual(spec: MachineSpec) -> ShoeVisual:
    """Return the visual shape of the shoes; their poses are `Tracks.shoe_poses`."""
    tracks = spec.tracks
    size = (_SHOE_LENGTH * tracks.pitch, tracks.shoe_width, tracks.shoe_thickness)
    return ShoeVisual(size, tracks.shoe_count, tracks.gauge, _SHOE_COLOR)
