"""Capped spring-damper: a wrench of the soil that resists motion and never drives it.

Rigid-plastic soil resists with a force F up to its strength. It is modelled, like the contact of
the tracks' shoes (`machine_sim.machine.tracks.terramechanics`), by a spring and a damper along the
direction of the force:

    f F = k x + c v,    0 <= f <= 1,

where v is the speed of the contact point against F, x its displacement against F since the soil
yielded last, and f the active fraction. While the soil yields, f is 1 and x stays at its limit. A
tool that the machine cannot push further stalls: the soil carries just the force of the machine.
Motion away from the soil unloads it. A force that changed with the sign of v would make the arm
oscillate at every step instead.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.box import Vec3

__all__ = ["CappedSpringDamper", "norm"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]


class CappedSpringDamper:
    """One wrench of the soil on a tool, and the fraction of it that acts.

    Attributes:
        force: maximum force [N], map axes, shape (3,).
        torque: its torque about the contact point [N m], map axes, shape (3,).
        contact_point: position of the contact point when the wrench was set [m], map frame.
        local_point: contact point in the tool frame [m]; `reset` leaves it.
        max_force: norm of the maximum force [N]; 0 without a wrench.
        active_fraction: fraction of the maximum force that acts, 0 to 1.
        displacement: of the contact point against the force since the soil yielded last [m].
    """

    def __init__(self, stiffness: float, damping: float, slack: float) -> None:
        """
        Args:
            stiffness: of the spring [N/m].
            damping: of the damper [N s/m].
            slack: distance [m] by which the point may move back before the soil's position moves
                back with it.
        """
        self._stiffness, self._damping, self._slack = stiffness, damping, slack
        self.local_point: Array = np.zeros(3)
        self._clear()

    def reset(self) -> None:
        """Remove the wrench, if there is one."""
        if self.max_force > 0.0:
            self._clear()

    def _clear(self) -> None:
        """Set all but the point in the tool frame to zero."""
        self.force: Array = np.zeros(3)
        self.torque: Array = np.zeros(3)
        self.contact_point: Array = np.zeros(3)
        self.max_force = self.active_fraction = self.displacement = 0.0

    @property
    def state(self) -> tuple[float, ...]:
        """All values that the next steps depend on."""
        return (
            *self.force,
            *self.torque,
            *self.contact_point,
            *self.local_point,
            self.displacement,
        )

    def set_wrench(self, wrench: tuple[Array, Array, Array], pose: Pose) -> None:
        """Replace the wrench.

        Args:
            wrench: contact point [m], force [N] and torque [N m] of the soil on the tool, map
                frame; the force is not zero.
            pose: of the tool frame when the contact point was there.
        """
        self.contact_point, self.force, self.torque = wrench
        self.max_force = norm(self.force)
        self.local_point = pose[0].T.dot(self.contact_point - pose[1])

    def distance_to_contact(self, pose: Pose) -> float:
        """Return the distance [m] of the tool's contact point from where the wrench was set."""
        return norm(pose[0].dot(self.local_point) + pose[1] - self.contact_point)

    def step(
        self, pose: Pose, velocity: tuple[Vec3, Vec3], dt: float, limit: float = math.inf
    ) -> tuple[float, ...]:
        """Return the wrench that acts in the next step: fx, fy, fz [N], tx, ty, tz [N m].

        Args:
            pose: of the tool frame.
            velocity: of its origin [m/s], and angular [rad/s], map axes.
            dt: physics step [s].
            limit: largest force in this step [N], if below the maximum force.

        Returns:
            Force, and torque about the tool frame's origin, map axes.
        """
        if self.max_force == 0.0:
            return (0.0,) * 6
        ax, ay, az = pose[0].dot(self.local_point).tolist()
        (vx, vy, vz), (wx, wy, wz) = velocity
        (fx, fy, fz), (tx, ty, tz) = self.force.tolist(), self.torque.tolist()
        # The velocity of the contact point is v + w x a.
        vx, vy, vz = vx + (wy * az - wz * ay), vy + (wz * ax - wx * az), vz + (wx * ay - wy * ax)
        speed = -(vx * fx + vy * fy + vz * fz) / self.max_force
        self.displacement += speed * dt
        uncapped = self._stiffness * self.displacement + self._damping * speed
        active_force = min(max(uncapped, 0.0), self.max_force, limit)
        if active_force == 0.0:  # the tool moves away from the soil
            self.displacement = min(max(self.displacement, -self._slack), 0.0)
        elif active_force != uncapped:  # the soil yields: the spring starts from here
            self.displacement = min(self.displacement, active_force / self._stiffness)
        self.active_fraction = active_fraction = active_force / self.max_force
        fx, fy, fz = active_fraction * fx, active_fraction * fy, active_fraction * fz
        tx = active_fraction * tx + (ay * fz - az * fy)
        ty = active_fraction * ty + (az * fx - ax * fz)
        tz = active_fraction * tz + (ax * fy - ay * fx)
        return fx, fy, fz, tx, ty, tz


def norm(vector: Array) -> float:
    """Return the length of a vector, shape (3,)."""
    x, y, z = vector.tolist()
    return math.sqrt(x * x + y * y + z * z)
