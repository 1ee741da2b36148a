"""Poses of all links in the map frame, from the base's pose and the joint angles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.cylinder_visuals import cylinder_joint_values, cylinder_parts
from machine_sim.machine.errors import MachineError
from machine_sim.machine.rotations import rotation_about_z, rotation_from_rpy, rotation_matrix
from machine_sim.machine.spec import BASE, Axis, MachineSpec
from machine_sim.machine.track_wheels import track_wheels

__all__ = ["LinkPoses", "link_frame_name", "link_frame_names", "link_frames", "link_poses"]

Array = NDArray[np.float64]


class LinkPoses(NamedTuple):
    """Poses of all links in the map frame, in the order of `link_frame_names`.

    Attributes:
        positions: origins of the link frames [m], shape (n, 3).
        quaternions: unit quaternions link to map, x, y, z, w, shape (n, 4).
    """

    positions: Array
    quaternions: Array


def link_frame_name(link: str) -> str:
    """Return the name of a link's frame in the URDF."""
    return "base_link" if link == BASE else link


def link_frame_names(spec: MachineSpec) -> list[str]:
    """Return the frame names of all links, the base first, then of the parts that are only shown.

    These are the cylinder parts, sprockets and idlers, and the points of view.
    """
    return [
        *map(link_frame_name, spec.links),
        *(part.link for part in cylinder_parts(spec)),
        *(wheel.link for wheel in track_wheels(spec)),
        *(view.name for view in spec.shapes.view_points),
    ]


def link_frames(
    spec: MachineSpec, base_position: Array, base_rotation: Array, joints: ArrayLike
) -> dict[str, tuple[Array, Array]]:
    """Return rotation to map (3, 3) and origin [m], map frame, (3,), of each rigid link by name.

    Args:
        spec: specification of the machine.
        base_position: origin of `base_link` [m], shape (3,), map frame.
        base_rotation: rotation from `base_link` to map, shape (3, 3).
        joints: joint angles [rad], shape (joints,).
    """
    frames = {BASE: (base_rotation, base_position)}
    angles = np.asarray(joints, dtype=np.float64).tolist()
    for joint, angle in zip(spec.joints.values(), angles, strict=True):
        rotation, origin = frames[joint.parent]
        frames[joint.child] = (
            rotation @ _axis_rotation(joint.axis, angle),
            origin + rotation @ np.array(joint.origin),
        )
    return frames


def link_poses(
    spec: MachineSpec,
    base_position: ArrayLike,
    base_quaternion: ArrayLike,
    joints: ArrayLike,
    sprockets: Sequence[float] = (0.0, 0.0),
) -> LinkPoses:
    """Return the poses of all links, without a physics engine.

    Args:
        spec: specification of the machine.
        base_position: origin of `base_link` [m], shape (3,), map frame.
        base_quaternion: quaternion `base_link` to map, x, y, z, w, of any length.
        joints: joint angles [rad], shape (joints,).
        sprockets: angles of the left and the right sprocket [rad].

    Raises:
        MachineError: a quaternion of length zero or not finite.
    """
    angles = np.asarray(joints, dtype=np.float64).tolist()
    base = np.asarray(base_quaternion, dtype=np.float64)
    length = float(np.linalg.norm(base))
    if not 0.0 < length < math.inf:  # also false for NaN
        raise MachineError(
            f"base_quaternion {base_quaternion!r} has length {length}; give a quaternion x, y, z, w"
        )
    quaternion: list[float] = (base / length).tolist()
    positions, quaternions = [np.array(base_position, dtype=np.float64)], [quaternion]
    index = {BASE: 0}
    for joint, angle in zip(spec.joints.values(), angles, strict=True):
        parent = index[joint.parent]
        quaternion = quaternions[parent]
        positions.append(positions[parent] + rotation_matrix(quaternion) @ np.array(joint.origin))
        quaternions.append(_rotated(quaternion, joint.axis, angle))
        index[joint.child] = len(positions) - 1
    values = cylinder_joint_values(spec, angles)
    for part, value in zip(cylinder_parts(spec), values, strict=True):
        parent = index[part.parent]
        offset = np.array([value, 0.0, 0.0] if part.is_prismatic else part.origin)
        quaternion = quaternions[parent]
        positions.append(positions[parent] + rotation_matrix(quaternion) @ offset)
        quaternions.append(quaternion if part.is_prismatic else _rotated(quaternion, "y", value))
        index[part.link] = len(positions) - 1
    base_rotation = rotation_matrix(quaternions[0])
    for wheel in track_wheels(spec):
        positions.append(positions[0] + base_rotation @ np.array(wheel.origin))
        quaternions.append(_rotated(quaternions[0], "y", sprockets[wheel.side]))
    for view in spec.shapes.view_points:
        parent = index[view.link]
        quaternion = quaternions[parent]
        positions.append(positions[parent] + rotation_matrix(quaternion) @ np.array(view.position))
        roll, pitch, yaw = view.rpy
        for axis, angle in (("z", yaw), ("y", pitch), ("x", roll)):
            quaternion = _rotated(quaternion, cast("Axis", axis), angle)
        quaternions.append(quaternion)
    return LinkPoses(np.array(positions), np.array(quaternions))


def _axis_rotation(axis: Axis, angle: float) -> Array:
    """Return the rotation matrix (3, 3) of an angle [rad] about one of the axes."""
    if axis == "z":
        return rotation_about_z(angle)
    return rotation_from_rpy((angle, 0.0, 0.0) if axis == "x" else (0.0, angle, 0.0))


def _rotated(quaternion: list[float], axis: Axis, angle: float) -> list[float]:
    """Return a quaternion followed by a rotation [rad] about one of the axes of its frame."""
    x, y, z, w = quaternion
    s, c = math.sin(0.5 * angle), math.cos(0.5 * angle)
    if axis == "x":
        return [c * x + s * w, c * y + s * z, c * z - s * y, c * w - s * x]
    if axis == "y":
        return [c * x - s * z, c * y + s * w, c * z + s * x, c * w - s * y]
    return [c * x + s * y, c * y - s * x, c * z + s * w, c * w - s * z]
