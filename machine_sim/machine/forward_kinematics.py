"""Poses of all links in the map frame, from the base's pose and the joint angles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.cylinder_visuals import cylinder_joint_values, cylinder_parts
from machine_sim.machine.errors import MachineError
from machine_sim.machine.rotations import rotation_matrix
from machine_sim.machine.spec import BASE, Axis, MachineSpec

__all__ = ["LinkPoses", "link_frame_name", "link_frame_names", "link_poses"]

Array = NDArray[np.float64]


class LinkPoses(NamedTuple):
    """Poses of all links in the map frame, in the order of `link_frame_names`.

    Attributes:
        positions: origins [m], shape (n, 3).
        quaternions: link to map, x, y, z, w, unit ones, shape (n, 4).
    """

    positions: Array
    quaternions: Array


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


def _rotated(quaternion: list[float], axis: Axis, angle: float) -> list[float]:
    """A rotation followed, in its own frame, by a turn [rad] about one of its axes."""
    x, y, z, w = quaternion
    s, c = math.sin(0.5 * angle), math.cos(0.5 * angle)
    if axis == "x":
        return [c * x + s * w, c * y + s * z, c * z - s * y, c * w - s * x]
    if axis == "y":
        return [c * x - s * z, c * y + s * w, c * z + s * x, c * w - s * y]
    return [c * x + s * y, c * y - s * x, c * z + s * w, c * w - s * z]
