"""Poses and velocities of all links from those of base and joints, without a physics engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.forward_kinematics import link_poses
from machine_sim.machine.rotations import cross, rotation_matrix
from machine_sim.machine.spec import BASE, MachineSpec

__all__ = ["LinkMotion", "link_motions"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """Pose and motion of a link frame in the map frame.

    Attributes:
        position: origin [m], shape (3,).
        quaternion: quaternion link to map, x, y, z, w.
        rotation: rotation matrix link to map, shape (3, 3).
        velocity: velocity of the origin [m/s], shape (3,).
        angular_velocity: angular velocity [rad/s], shape (3,).
    """

    position: Array
    quaternion: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array

    def velocity_at(self, point: ArrayLike) -> Array:
        """Return the velocity [m/s], map frame, of a point [m] in the link frame, shape (3,)."""
        arm = self.rotation @ np.asarray(point, dtype=np.float64)
        return self.velocity + cross(self.angular_velocity, arm)


def link_motions(
    spec: MachineSpec,
    base_position: ArrayLike,
    base_quaternion: ArrayLike,
    base_velocity: ArrayLike,
    base_angular_velocity: ArrayLike,
    joints: ArrayLike,
    rates: Sequence[float] | Array,
) -> dict[str, LinkMotion]:
    """Return the motion of each link, by name.

    Args:
        spec: specification of the machine.
        base_position, base_quaternion: pose of `base_link`, map frame [m].
        base_velocity, base_angular_velocity: velocity of its origin [m/s] and angular velocity
            [rad/s], map frame.
        joints, rates: joint angles [rad] and velocities [rad/s].

    Raises:
        MachineError: a quaternion of length zero or not finite.
    """
    poses = link_poses(spec, base_position, base_quaternion, joints)
    base = LinkMotion(
        poses.positions[0],
        poses.quaternions[0],
        rotation_matrix(poses.quaternions[0]),
        np.array(base_velocity, dtype=np.float64),
        np.array(base_angular_velocity, dtype=np.float64),
    )
    motions = {BASE: base}
    for k, joint in enumerate(spec.joints.values()):
        position, quaternion = poses.positions[k + 1], poses.quaternions[k + 1]
        rotation, parent = rotation_matrix(quaternion), motions[joint.parent]
        velocity = parent.velocity + cross(parent.angular_velocity, position - parent.position)
        angular_velocity = parent.angular_velocity + rotation[:, "xyz".index(joint.axis)] * rates[k]
        motions[joint.child] = LinkMotion(
            position, quaternion, rotation, velocity, angular_velocity
        )
    return motions
