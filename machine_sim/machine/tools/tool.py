"""A tool of a machine in pybullet: where it is, how it moves, and what pushes it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.rotations import cross, rotation_matrix
from machine_sim.machine.spec import LinkSpec
from machine_sim.machine.tools.shapes import ToolShape
from machine_sim.machine.validation import finite_numbers
from machine_sim.physics_engine import pybullet

__all__ = ["Tool"]

Array = NDArray[np.float64]


class Tool:
    """What touches soil, fixed to a link, whose frame is its own.

    Attributes:
        shape: of the tool.
        mass: of its link [kg].
        inertia: of its link about its y axis [kg m^2].
        spin: how fast a drum turns on its joint [rad/s], 0 for any other tool.
    """

    def __init__(
        self, client: int, body: int, link: int, shape: ToolShape, of_link: LinkSpec
    ) -> None:
        """
        Args:
            client, body, link: numbers of the physics client, the machine and the link there.
            shape: of the tool.
            of_link: what its link is.
        """
        self.shape = shape
        self.mass = of_link.mass
        self.inertia = of_link.inertia[1]
        self._client, self._body, self._link = client, body, link
        self._com = np.array(of_link.center_of_mass)
        self._spins = shape.spins
        self._joint_angle = 0.0
        self.drum_speed = 0.0
        self._force, self._torque = [0.0] * 3, [0.0] * 3  # torque about the frame's origin
        self._pushed = False

    def push(self, force: ArrayLike, torque: ArrayLike, point: ArrayLike | None = None) -> None:
        """Add a wrench for the next step only.

        Args:
            force: [N], map frame, shape (3,).
            torque: about `point` [N m], map frame, shape (3,).
            point: where the force acts [m], map frame; the frame's origin if not given.

        Raises:
            MachineError: a wrong length or a number that is not finite; nothing is added.
        """
        f, t = finite_numbers(force, 3, "tool force"), finite_numbers(torque, 3, "tool torque")
        if point is not None:
            at = np.array(finite_numbers(point, 3, "point of the wrench"))
            t = (np.array(t) + cross(at - self._origin, np.array(f))).tolist()
        self._force = [a + b for a, b in zip(self._force, f, strict=True)]
        self._torque = [a + b for a, b in zip(self._torque, t, strict=True)]
        self._pushed = True

    def before_step(self) -> None:
        """Give the physics engine what pushes it in the next step."""
        if not self._pushed:
            return
        body, link, client, world = self._body, self._link, self._client, pybullet.WORLD_FRAME
        at = self._origin.tolist()
        pybullet.applyExternalForce(body, link, self._force, at, world, client)
        pybullet.applyExternalTorque(body, link, self._torque, world, client)
        self._force, self._torque = [0.0] * 3, [0.0] * 3
        self._pushed = False

    def after_step(self) -> None:
        """Read where it is; every property is of this moment until the next call."""
        state = pybullet.getLinkState(self._body, self._link, 1, 1, self._client)
        # [4] and [5] are the link frame; [0] and [1] would be that of the centre of mass.
        self._origin = np.array(state[4])
        self._rotation = rotation_matrix(state[5])
        self._com_velocity, self._angular_velocity = state[6], state[7]
        if self._spins:
            joint = pybullet.getJointState(self._body, self._link, self._client)
            self._joint_angle, self.drum_speed = joint[0], joint[1]

    @property
    def pose(self) -> tuple[Array, Array]:
        """Rotation tool to map, shape (3, 3), and the frame's origin [m], shape (3,)."""
        return self._rotation, self._origin

    @property
    def frame(self) -> tuple[Array, Array]:
        """The same for what is beside a tool and not on it: the frame of a drum does not spin."""
        if not self._spins:
            return self._rotation, self._origin
        s, c = math.sin(self._joint_angle), math.cos(self._joint_angle)
        back = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        return self._rotation @ back, self._origin

    @property
    def velocity(self) -> tuple[Array, Array]:
        """Velocity of the frame's origin [m/s], angular velocity [rad/s], map frame."""
        spin = np.array(self._angular_velocity)
        arm = self._rotation @ self._com
        return np.array(self._com_velocity) - cross(spin, arm), spin
