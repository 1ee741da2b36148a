"""A machine as flat faces, for pictures: boxes of its links, pistons and track shoes."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine import MachineSpec
from machine_sim.machine.forward_kinematics import link_frame_names, link_poses
from machine_sim.machine.rotations import quaternion_from_matrix, rotation_matrix
from machine_sim.machine.visuals import VisualBox, link_visual_boxes, shoe_visual

__all__ = ["machine_faces", "machine_outline"]

Array = NDArray[np.float64]
Frame = tuple[Array, Array]

_BOX_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def machine_faces(
    machine: MachineSpec,
    position: ArrayLike,
    rotation: Array,
    joints: ArrayLike,
    shoes: Array | None = None,
) -> list[tuple[str, Array]]:
    """Return the faces of a machine in a pose.

    Args:
        machine: the machine.
        position: position of base_link [m], map frame, shape (3,).
        rotation: rotation from base_link to map, shape (3, 3).
        joints: angles of its joints [rad].
        shoes: x, z [m] and pitch [rad] of the track shoes in the base frame, shape (2, n, 3),
            left track first; None draws no shoes.

    Returns:
        Colour and polygon (k, 3) [m], map frame, of each face.
    """
    frames = _link_frames(machine, position, rotation, joints)
    faces = []
    for box in _cached_link_boxes(machine):
        turn, origin = frames[box.link]
        corners = _box_corners(box.size, box.center, box.pitch) @ turn.T + origin
        faces += [(_hex_color(box.color), corners[list(face)]) for face in _BOX_FACES]
    if shoes is not None:
        turn, origin = frames["base_link"]
        color = _hex_color(shoe_visual(machine).color)
        for corners in _shoe_boxes(machine, shoes):
            placed = corners @ turn.T + origin
            faces += [(color, placed[list(face)]) for face in _BOX_FACES]
    return faces


def machine_outline(
    machine: MachineSpec, position: ArrayLike, rotation: Array, joints: ArrayLike
) -> list[tuple[str, Array]]:
    """Return link name and plan-view polygon (k, 2) [m], map frame, of base and main body."""
    frames = _link_frames(machine, position, rotation, joints)
    outline = []
    for name in dict.fromkeys(("base", machine.main_body)):
        turn, origin = frames["base_link" if name == "base" else name]
        for box in machine.links[name].boxes:
            corners = _box_corners(box.size, box.center, box.pitch) @ turn.T + origin
            # Corners 0, 1, 3, 2 are the bottom face in order.
            outline.append((name, corners[[0, 1, 3, 2], :2]))
    return outline


@lru_cache(maxsize=8)
def _cached_link_boxes(machine: MachineSpec) -> list[VisualBox]:
    return link_visual_boxes(machine)


def _link_frames(
    machine: MachineSpec, position: ArrayLike, rotation: Array, joints: ArrayLike
) -> dict[str, Frame]:
    """Return the rotation to the map (3, 3) and the origin [m] of every link, by name."""
    poses = link_poses(machine, position, quaternion_from_matrix(rotation), joints)
    return {
        name: (rotation_matrix(quaternion), origin)
        for name, origin, quaternion in zip(link_frame_names(machine), *poses, strict=True)
    }


def _shoe_boxes(machine: MachineSpec, shoes: Array) -> list[Array]:
    """Return the corners of every shoe in the base frame [m], shape (8, 3) each."""
    visual = shoe_visual(machine)
    boxes = []
    for side, y in ((0, 0.5 * visual.gauge), (1, -0.5 * visual.gauge)):
        boxes += [_box_corners(visual.shoe_size, (x, y, z), pitch) for x, z, pitch in shoes[side]]
    return boxes


def _box_corners(size: ArrayLike, center: ArrayLike, pitch: float) -> Array:
    """Return the eight corners of a link's box in the link frame [m], shape (8, 3)."""
    signs = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
    s, c = math.sin(pitch), math.cos(pitch)
    about_y = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    corners: Array = 0.5 * signs * np.asarray(size) @ about_y.T + np.asarray(center)
    return corners


def _hex_color(color: tuple[float, ...]) -> str:
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in color[:3])
