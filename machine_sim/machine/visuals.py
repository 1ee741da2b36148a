"""The machine as others see it: where each link is, and what it looks like there."""

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
"""Length of a drawn shoe in parts of the pitch, so that one is told from the next."""


class VisualBox(NamedTuple):
    """A box of a link: its frame, edges [m], middle [m], turn about +y [rad], r, g, b, a."""

    link: str
    size: Vec3
    center: Vec3
    pitch: float
    color: Rgba


class ShoeVisual(NamedTuple):
    """Shoes of both tracks: size along, across, thick [m]; count of one; gauge [m]; r, g, b, a."""

    shoe_size: Vec3
    shoe_count: int
    gauge: float
    color: Rgba


def link_visual_boxes(spec: MachineSpec, *, prefix: str = "") -> list[VisualBox]:
    """What is seen of every link but the shoes, read from the URDF so that the two are one.

    Args:
        description: the machine.
        prefix: put before each link's name, as in the URDF.
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
    """What is seen of the tracks' shoes; `Tracks.shoe_poses` says where."""
    tracks = spec.tracks
    size = (_SHOE_LENGTH * tracks.pitch, tracks.shoe_width, tracks.shoe_thickness)
    return ShoeVisual(size, tracks.shoe_count, tracks.gauge, _SHOE_COLOR)


def _numbers(visual: ET.Element, path: str, name: str) -> list[float]:
    found = visual.find(path)
    assert found is not None  # `urdf_text` writes it
    return [float(number) for number in found.attrib[name].split()]


def _vec3(numbers: list[float]) -> Vec3:
    x, y, z = numbers
    return x, y, z


def _rgba(numbers: list[float]) -> Rgba:
    r, g, b, a = numbers
    return r, g, b, a
