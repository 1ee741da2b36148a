"""A tool of a machine in pybullet: its pose and velocity, and the wrench on it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.box import Vec3
from machine_sim.machine.errors import MachineError
from machine_sim.machine.rotations import cross, pose_of
from machine_sim.machine.spec import LinkSpec
from machine_sim.machine.tools.shapes import ToolShape
from machine_sim.machine.validation import finite_numbers
from machine_sim.physics_engine import pybullet

__all__ = ["MIN_DRUM_SPEED", "Tool"]

Array = NDArray[np.float64]

MIN_DRUM_SPEED = 0.5
"""Minimum angular speed [rad/s] at which a drum mills."""


class Tool:
    """A tool, fixed to a link; the tool frame is the link frame.

    Attributes:
        shape: shape of the tool.
        mass: mass of its link [kg].
        inertia: moment of inertia of its link about y through the centre of mass [kg m^2].
        pose: rotation matrix tool to map, shape (3, 3), and origin of the frame [m], shape (3,),
            map frame; arrays that later steps do not change.
        frame: pose without the rotation of a spinning tool about its joint.
        drum_speed: angular speed of the joint of a spinning tool [rad/s], 0 for others.
        commanded_drum_speed: angular speed that its drive is commanded to [rad/s].
        drum_torque: maximum torque of its drive [N m].
    """

    pose: tuple[Array, Array]
    frame: tuple[Array, Array]

    def __init__(
        self,
        client: int,
        body: int,
        link: int,
        shape: ToolShape,
        link_spec: LinkSpec,
        max_effort: float,
    ) -> None:
        """
        Args:
            client, body, link: ids of the physics client, the machine and the link.
            shape: shape of the tool.
            link_spec: specification of the link.
            max_effort: maximum torque of the joint that moves the link [N m].
        """
        self.shape = shape
        self.mass = link_spec.mass
        self.inertia = link_spec.inertia[1]
        self._client, self._body, self._link = client, body, link
        self._com = np.array(link_spec.center_of_mass)
        self._inverse_spin = np.eye(3)  # rotation matrix of minus the joint angle about y
        self.drum_speed = self.commanded_drum_speed = 0.0
        self.drum_torque = max_effort if shape.spins else 0.0
        self._wrench: list[float] = []  # force, and torque about the frame's origin; empty for none

    def push(self, force: ArrayLike, torque: ArrayLike, point: ArrayLike | None = None) -> None:
        """Add a wrench that acts in the next step only.

        Args:
            force: force [N], map frame, shape (3,).
            torque: torque about `point` [N m], map frame, shape (3,).
            point: point of application [m], map frame; by default the origin of the tool frame.

        Raises:
            MachineError: a wrong length or a number that is not finite; nothing is added.
        """
        f, t = finite_numbers(force, 3, "tool force"), finite_numbers(torque, 3, "tool torque")
        if point is not None:
            at = np.array(finite_numbers(point, 3, "point of the wrench"))
            t = (np.array(t) + cross(at - self.pose[1], np.array(f))).tolist()
        self.add_wrench([*f, *t])

    def add_wrench(self, wrench: list[float]) -> None:
        """Add a wrench that acts in the next step only.

        Args:
            wrench: force [N] and torque about the origin of the tool frame [N m], map axes, six
                numbers.

        Raises:
            MachineError: a number that is not finite; nothing is added.
        """
        if not math.isfinite(sum(wrench)):
            raise MachineError(f"tool wrench {wrench!r}: give finite numbers")
        present = self._wrench
        self._wrench = [a + b for a, b in zip(present, wrench, strict=True)] if present else wrench

    def before_step(self) -> None:
        """Apply the wrench in the physics engine's next step."""
        if not self._wrench:
            return
        body, link, client, world = self._body, self._link, self._client, pybullet.WORLD_FRAME
        force, torque = self._wrench[:3], self._wrench[3:]
        pybullet.applyExternalForce(body, link, force, self._origin_list, world, client)
        pybullet.applyExternalTorque(body, link, torque, world, client)
        self._wrench = []

    def after_step(self, joint_angle: float, joint_rate: float) -> None:
        """Read the state after a step; every property has that state until the next call.

        Args:
            joint_angle, joint_rate: angle [rad] and speed [rad/s] of the joint that moves the link.
        """
        (_, _, _, _, self._origin_list, quaternion, self._com_velocity, self._angular_velocity) = (
            pybullet.getLinkState(self._body, self._link, 1, 1, self._client)
        )
        self.pose = self.frame = pose_of(self._origin_list, quaternion)
        if self.shape.spins:
            self.drum_speed = joint_rate
            s, c = math.sin(joint_angle), math.cos(joint_angle)
            inverse = self._inverse_spin
            inverse[0, 0], inverse[0, 2], inverse[2, 0], inverse[2, 2] = c, -s, s, c
            rotation, origin = self.pose
            self.frame = rotation.dot(inverse), origin

    @property
    def is_driven(self) -> bool:
        """Whether a drum spins or is commanded to spin; False for other tools."""
        return abs(self.drum_speed) >= MIN_DRUM_SPEED or self.commanded_drum_speed != 0.0

    @property
    def velocity(self) -> tuple[Vec3, Vec3]:
        """Velocity of the tool frame's origin [m/s] and angular velocity [rad/s], map frame."""
        (vx, vy, vz), (wx, wy, wz) = self._com_velocity, self._angular_velocity
        x, y, z = self.pose[0].dot(self._com).tolist()
        velocity = (vx - (wy * z - wz * y), vy - (wz * x - wx * z), vz - (wx * y - wy * x))
        return velocity, self._angular_velocity
