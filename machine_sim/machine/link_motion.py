"""How every link moves: poses and velocities from the base and the joints, no physics engine."""

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
    """Pose and motion of a link's frame, map axes.

    Attributes:
        position: origin [m], shape (3,).
        quaternion: link to map, x, y, z, w.
        rotation: the same as a matrix, shape (3, 3).
        velocity: of the origin [m/s], shape (3,).
        spin: angular velocity [rad/s], shape (3,).
    """

    position: Array
    quaternion: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array

    def velocity_at(self, point: ArrayLike) -> Array:
        """Velocity of a point of the link [m], link frame, shape (3,)."""
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
    """Motion of each link, by name.

    Args:
        description: the machine.
        base_position, base_quaternion: of `base_link`, map frame.
        base_velocity, base_spin: of its origin [m/s], and angular [rad/s], map frame.
        joints, rates: of its joints [rad], [rad/s].

    Raises:
        MachineError: a quaternion of no length.
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
        rotation, before = rotation_matrix(quaternion), motions[joint.parent]
        velocity = before.velocity + cross(before.angular_velocity, position - before.position)
        angular_velocity = before.angular_velocity + rotation[:, "xyz".index(joint.axis)] * rates[k]
        motions[joint.child] = LinkMotion(
            position, quaternion, rotation, velocity, angular_velocity
        )
    return motions
