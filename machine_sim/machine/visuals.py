"""The machine as others see it: where each link is, and what it looks like there."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.arm_kinematics import rotation_matrix
from machine_sim.machine.cylinder_visuals import cylinder_joint_values, cylinder_parts
from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import BASE, Axis, MachineSpec, Vec3
from machine_sim.machine.urdf import urdf_text

__all__ = [
    "LinkPoses",
    "ShoeVisual",
    "VisualBox",
    "link_frame_name",
    "link_frame_names",
    "link_poses",
    "link_visual_boxes",
    "shoe_visual",
]

Array = NDArray[np.float64]
Rgba = tuple[float, float, float, float]

_SHOE_COLOR = (0.33, 0.35, 0.36, 1.0)

_SHOE_LENGTH = 0.96
"""Length of a drawn shoe in parts of the pitch, so that one is told from the next."""


class LinkPoses(NamedTuple):
    """Poses of all links in the map frame, in the order of `link_frame_names`.

    Attributes:
        positions: origins [m], shape (n, 3).
        quaternions: link to map, x, y, z, w, unit ones, shape (n, 4).
    """

    positions: Array
    quaternions: Array


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


def link_frame_name(link: str) -> str:
    """Name of a link's frame, as in the URDF."""
    return "base_link" if link == BASE else link


def link_frame_names(spec: MachineSpec) -> list[str]:
    """Names of the frames of all links, the base first, then of the pistons."""
    return [
        *map(link_frame_name, spec.links),
        *(part.link for part in cylinder_parts(spec)),
    ]


def link_poses(
    spec: MachineSpec,
    base_position: ArrayLike,
    base_quaternion: ArrayLike,
    joints: ArrayLike,
) -> LinkPoses:
    """Where every link is, without a physics engine.

    Args:
        description: the machine.
        base_position: origin of `base_link` [m], shape (3,), map frame.
        base_quaternion: `base_link` to map, x, y, z, w; made a unit one.
        joints: angles of its joints [rad].

    Raises:
        MachineError: a quaternion of no length.
    """
    angles = np.asarray(joints, dtype=np.float64).tolist()
    first = np.asarray(base_quaternion, dtype=np.float64)
    length = float(np.linalg.norm(first))
    if not 0.0 < length < math.inf:  # NaN fails
        raise MachineError(f"{base_quaternion!r} is no rotation; give a quaternion x, y, z, w")
    turn: list[float] = (first / length).tolist()
    positions, quaternions = [np.array(base_position, dtype=np.float64)], [turn]
    place = {BASE: 0}
    for joint, angle in zip(spec.joints.values(), angles, strict=True):
        parent = place[joint.parent]
        before = quaternions[parent]
        positions.append(positions[parent] + rotation_matrix(before) @ np.array(joint.origin))
        quaternions.append(_rotated(before, joint.axis, angle))
        place[joint.child] = len(positions) - 1
    values = cylinder_joint_values(spec, angles)
    for part, value in zip(cylinder_parts(spec), values, strict=True):
        parent = place[part.parent]
        offset = np.array([value, 0.0, 0.0] if part.is_prismatic else part.origin)
        turn = quaternions[parent]
        positions.append(positions[parent] + rotation_matrix(turn) @ offset)
        quaternions.append(turn if part.is_prismatic else _rotated(turn, "y", value))
        place[part.link] = len(positions) - 1
    return LinkPoses(np.array(positions), np.array(quaternions))


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


def _rotated(quaternion: list[float], axis: Axis, angle: float) -> list[float]:
    """A rotation followed, in its own frame, by a turn [rad] about one of its axes."""
    x, y, z, w = quaternion
    s, c = math.sin(0.5 * angle), math.cos(0.5 * angle)
    if axis == "x":
        return [c * x + s * w, c * y + s * z, c * z - s * y, c * w - s * x]
    if axis == "y":
        return [c * x - s * z, c * y + s * w, c * z + s * x, c * w - s * y]
    return [c * x + s * y, c * y - s * x, c * z + s * w, c * w - s * z]


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
