"""Visual shapes of a machine: boxes of the links and shoes of the tracks."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import NamedTuple

from machine_sim.machine.spec import MachineSpec, Vec3
from machine_sim.machine.urdf import urdf_text

__all__ = [
    "ShoeVisual",
    "VisualBox",
    "link_visual_boxes",
    "shoe_visual",
]

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


def link_visual_boxes(spec: MachineSpec, *, prefix: str = "") -> list[VisualBox]:
    """Return the visual boxes of all links, read from the URDF so that both agree.

    Args:
        spec: specification of the machine.
        prefix: prefix of each link name, as in the URDF.
    """
    boxes = []
    for link in ET.fromstring(urdf_text(spec, prefix=prefix, include_cylinders=True)).iter("link"):
        for visual in link.iter("visual"):
            origin = _numbers(visual, "origin", "xyz")
            _, pitch, _ = _numbers(visual, "origin", "rpy")
            size = _numbers(visual, "geometry/box", "size")
            color = _numbers(visual, "material/color", "rgba")
            boxes.append(
                VisualBox(link.attrib["name"], _vec3(size), _vec3(origin), pitch, _rgba(color))
            )
    return boxes


def shoe_visual(spec: MachineSpec) -> ShoeVisual:
    """Return the visual shape of the shoes; their poses are `Tracks.shoe_poses`."""
    tracks = spec.tracks
    size = (_SHOE_LENGTH * tracks.pitch, tracks.shoe_width, tracks.shoe_thickness)
    return ShoeVisual(size, tracks.shoe_count, tracks.gauge, _SHOE_COLOR)


def _numbers(visual: ET.Element, path: str, name: str) -> list[float]:
    element = visual.find(path)
    assert element is not None  # `urdf_text` writes it
    return [float(number) for number in element.attrib[name].split()]


def _vec3(numbers: list[float]) -> Vec3:
    x, y, z = numbers
    return x, y, z


def _rgba(numbers: list[float]) -> Rgba:
    r, g, b, a = numbers
    return r, g, b, a
