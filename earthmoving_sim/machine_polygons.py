"""A machine as flat faces, for pictures: the boxes of its links, its pistons and its shoes."""

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
    """Faces of a machine in a pose.

    Args:
        machine: its description.
        position, rotation: of base_link, (3,) [m] and (3, 3), map frame.
        joints: angles of its joints [rad].
        shoes: x, z [m] and pitch [rad] of the tracks' shoes in the base frame, shape (2, n, 3),
            left track first; none are drawn if not given.

    Returns:
        (colour, polygon (k, 3) [m], map frame) of each face.
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
    """Plan view of the base and the main body: (link, polygon (k, 2) [m], map frame)."""
    frames = _link_frames(machine, position, rotation, joints)
    outline = []
    for name in dict.fromkeys(("base", machine.main_body)):
        turn, origin = frames["base_link" if name == "base" else name]
        for box in machine.links[name].boxes:
            corners = _box_corners(box.size, box.center, box.pitch) @ turn.T + origin
            # Corners 0, 1, 3, 2 go around the bottom face.
            outline.append((name, corners[[0, 1, 3, 2], :2]))
    return outline


@lru_cache(maxsize=8)
def _cached_link_boxes(machine: MachineSpec) -> list[VisualBox]:
    return link_visual_boxes(machine)


def _link_frames(
    machine: MachineSpec, position: ArrayLike, rotation: Array, joints: ArrayLike
) -> dict[str, Frame]:
    """Rotation link to map and origin [m] of every link."""
    poses = link_poses(machine, position, quaternion_from_matrix(rotation), joints)
    return {
        name: (rotation_matrix(quaternion), origin)
        for name, origin, quaternion in zip(link_frame_names(machine), *poses, strict=True)
    }


def _shoe_boxes(machine: MachineSpec, shoes: Array) -> list[Array]:
    """Corners of every shoe in the base frame, shape (8, 3) each."""
    look = shoe_visual(machine)
    boxes = []
    for side, y in ((0, 0.5 * look.gauge), (1, -0.5 * look.gauge)):
        boxes += [_box_corners(look.shoe_size, (x, y, z), pitch) for x, z, pitch in shoes[side]]
    return boxes


def _box_corners(size: ArrayLike, center: ArrayLike, pitch: float) -> Array:
    """The eight corners of a link's box in the link frame, shape (8, 3)."""
    signs = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
    s, c = math.sin(pitch), math.cos(pitch)
    about_y = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    corners: Array = 0.5 * signs * np.asarray(size) @ about_y.T + np.asarray(center)
    return corners


def _hex_color(color: tuple[float, ...]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in color[:3])
