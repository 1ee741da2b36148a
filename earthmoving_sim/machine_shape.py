"""The machine as flat faces, for pictures: boxes of its links and plates of its bucket."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine import MachineDescription
from machine_sim.machine.kinematics import rotation_about_z

__all__ = ["machine_faces", "machine_outline"]

Array = NDArray[np.float64]
Frame = tuple[Array, Array]

_COLOURS = {
    "base": "#3d4045",
    "shoes": "#55585d",
    "upper": "#e0a91b",
    "boom": "#e0a91b",
    "arm": "#d19c17",
    "bucket": "#6b6e73",
}

_BOX_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def machine_faces(
    machine: MachineDescription,
    position: ArrayLike,
    rotation: Array,
    joints: ArrayLike,
    shoes: Array | None = None,
) -> list[tuple[str, Array]]:
    """Faces of a machine in a pose.

    Args:
        machine: its description.
        position, rotation: of base_link, (3,) [m] and (3, 3), map frame.
        joints: swing, boom, arm, bucket [rad].
        shoes: x, z [m] and pitch [rad] of the tracks' shoes in the base frame, shape (2, n, 3),
            left track first; none are drawn if not given.

    Returns:
        (colour, polygon (k, 3) [m], map frame) of each face.
    """
    frames = _link_frames(machine, np.asarray(position, dtype=np.float64), rotation, joints)
    faces = []
    for name, link in machine.links.items():
        turn, origin = frames[name]
        for box in link.boxes:
            corners = _box_corners(box.size, box.center, box.pitch) @ turn.T + origin
            faces += [(_COLOURS[name], corners[list(face)]) for face in _BOX_FACES]
    if shoes is not None:
        turn, origin = frames["base"]
        for corners in _shoe_boxes(machine, shoes):
            placed = corners @ turn.T + origin
            faces += [(_COLOURS["shoes"], placed[list(face)]) for face in _BOX_FACES]
    turn, origin = frames["bucket"]
    faces += [(_COLOURS["bucket"], plate @ turn.T + origin) for plate in machine.bucket.plates()]
    return faces


def machine_outline(
    machine: MachineDescription, position: ArrayLike, rotation: Array, joints: ArrayLike
) -> list[tuple[str, Array]]:
    """Plan view of the tracks and the upper body: (name, polygon (k, 2) [m], map frame)."""
    frames = _link_frames(machine, np.asarray(position, dtype=np.float64), rotation, joints)
    outline = []
    for name in ("base", "upper"):
        turn, origin = frames[name]
        for box in machine.links[name].boxes:
            corners = _box_corners(box.size, box.center, box.pitch) @ turn.T + origin
            # Corners 0, 1, 3, 2 go around the bottom face.
            outline.append((name, corners[[0, 1, 3, 2], :2]))
    return outline


def _link_frames(
    machine: MachineDescription, position: Array, rotation: Array, joints: ArrayLike
) -> dict[str, Frame]:
    """Rotation link to map and origin [m] of every link."""
    swing, boom, arm, bucket = np.asarray(joints, dtype=np.float64)
    frames: dict[str, Frame] = {"base": (rotation, position)}
    steps = (
        ("upper", machine.swing_origin, rotation_about_z(swing)),
        ("boom", machine.boom_foot, _about_y(boom)),
        ("arm", (machine.boom_length, 0.0, 0.0), _about_y(arm)),
        ("bucket", (machine.arm_length, 0.0, 0.0), _about_y(bucket)),
    )
    turn, origin = frames["base"]
    for name, offset, joint in steps:
        origin = origin + turn @ np.array(offset)
        turn = turn @ joint
        frames[name] = (turn, origin)
    return frames


def _shoe_boxes(machine: MachineDescription, shoes: Array) -> list[Array]:
    """Corners of every shoe in the base frame, shape (8, 3) each."""
    tracks = machine.tracks
    size = (0.96 * tracks.pitch, tracks.shoe_width, tracks.shoe_thickness)
    boxes = []
    for side, y in ((0, 0.5 * tracks.gauge), (1, -0.5 * tracks.gauge)):
        boxes += [_box_corners(size, (x, y, z), pitch) for x, z, pitch in shoes[side]]
    return boxes


def _box_corners(size: ArrayLike, center: ArrayLike, pitch: float) -> Array:
    """The eight corners of a link's box in the link frame, shape (8, 3)."""
    signs = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
    corners: Array = 0.5 * signs * np.asarray(size) @ _about_y(pitch).T + np.asarray(center)
    return corners


def _about_y(angle: float) -> Array:
    s, c = math.sin(angle), math.cos(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
