"""A machine from above: outlines of its base and its main body, for maps."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine import MachineSpec
from machine_sim.machine.box import Box
from machine_sim.machine.forward_kinematics import link_frame_name, link_frame_names, link_poses
from machine_sim.machine.rotations import quaternion_from_matrix, rotation_matrix

__all__ = ["machine_outline"]

Array = NDArray[np.float64]


def machine_outline(
    machine: MachineSpec, position: ArrayLike, rotation: Array, joints: ArrayLike
) -> list[tuple[str, Array]]:
    """Return link name and plan-view polygon (k, 2) [m], map frame, of the boxes of base and body.

    Args:
        machine: the machine.
        position: position of base_link [m], map frame, shape (3,).
        rotation: rotation from base_link to map, shape (3, 3).
        joints: angles of its joints [rad].
    """
    poses = link_poses(machine, position, quaternion_from_matrix(rotation), joints)
    frames = dict(zip(link_frame_names(machine), zip(*poses, strict=True), strict=True))
    outline: list[tuple[str, Array]] = []
    for name in dict.fromkeys(("base", machine.main_body)):
        origin, quaternion = frames[link_frame_name(name)]
        turn = rotation_matrix(quaternion)
        outline += [
            (name, (_bottom_corners(box) @ turn.T + origin)[:, :2])
            for box in machine.links[name].boxes
        ]
    return outline


def _bottom_corners(box: Box) -> Array:
    """Return the corners of a box's lower face in the link frame [m], in order, shape (4, 3)."""
    signs = np.array([(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)], dtype=float)
    s, c = math.sin(box.pitch), math.cos(box.pitch)
    about_y = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    corners: Array = 0.5 * signs * np.asarray(box.size) @ about_y.T + np.asarray(box.center)
    return corners
