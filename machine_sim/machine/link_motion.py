"""How every link moves: poses and velocities from the base and the joints, no physics engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.appearance import link_poses
from machine_sim.machine.description import LINK_NAMES, MachineDescription
from machine_sim.machine.kinematics import cross, rotation_matrix

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
    spin: Array

    def velocity_at(self, point: ArrayLike) -> Array:
        """Velocity of a point of the link [m], link frame, shape (3,)."""
        arm = self.rotation @ np.asarray(point, dtype=np.float64)
        return self.velocity + cross(self.spin, arm)


def link_motions(
    description: MachineDescription,
    base_position: ArrayLike,
    base_quaternion: ArrayLike,
    base_velocity: ArrayLike,
    base_spin: ArrayLike,
    joints: ArrayLike,
    rates: Sequence[float] | Array,
) -> dict[str, LinkMotion]:
    """Motion of each link, by name.

    Args:
        description: the machine.
        base_position, base_quaternion: of `base_link`, map frame.
        base_velocity, base_spin: of its origin [m/s], and angular [rad/s], map frame.
        joints, rates: swing, boom, arm, bucket [rad], [rad/s].

    Raises:
        MachineError: a quaternion of no length.
    """
    poses = link_poses(description, base_position, base_quaternion, joints)
    motions: dict[str, LinkMotion] = {}
    before: LinkMotion | None = None
    for k, name in enumerate(LINK_NAMES):
        position, quaternion = poses.positions[k], poses.quaternions[k]
        rotation = rotation_matrix(quaternion)
        if before is None:
            velocity = np.array(base_velocity, dtype=np.float64)
            spin = np.array(base_spin, dtype=np.float64)
        else:
            # The swing turns about z, the arm's joints about y; the axis is the link's own.
            axis = rotation[:, 2 if k == 1 else 1]
            velocity = before.velocity + cross(before.spin, position - before.position)
            spin = before.spin + axis * rates[k - 1]
        before = LinkMotion(position, quaternion, rotation, velocity, spin)
        motions[name] = before
    return motions
