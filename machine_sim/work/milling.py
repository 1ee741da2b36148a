"""The soil as a drum with picks feels it: it takes torque and thrust while the drum spins in it.

The soil answers a tick with the wrench of what the picks cut then; it comes a tick or two later,
and acts until the next. It never drives: where it would stop the drum within a step or two, as much
of it acts as brakes what spin there is, and none against a drum that stands or turns the other way.
That is a drum that stalls. One that stands in soil is borne by it like any other tool
(`machine_sim.work.resistance`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineError
from machine_sim.machine.kinematics import cross
from machine_sim.work.resistance import LAPSE, Resistance
from msg_bridge.contract.rows import Holds, Rows

__all__ = ["SPINS", "Milling"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

SPINS = 0.5
"""Spin [rad/s] from which on a drum cuts."""

_BRAKED = 0.3
"""Part of its spin that a drum can lose in a step."""

_FIELDS = (("x", "y", "z"), ("fx", "fy", "fz"), ("tx", "ty", "tz"))


class Milling:
    """What soil does to one drum.

    Attributes:
        borne: what bears it while it stands.
    """

    def __init__(self, tool_mass: float, machine_mass: float, inertia: float, dt: float) -> None:
        """
        Args:
            tool_mass: of the drum's link [kg].
            machine_mass: of all of it [kg].
            inertia: of the drum about its axis [kg m^2].
            dt: physics step [s].
        """
        self._brakes = _BRAKED * inertia / dt  # torque over spin
        self.borne = Resistance(tool_mass, machine_mass, dt)
        self._age = 0
        self._point: Array = np.zeros(3)
        self._force: Array = np.zeros(3)
        self._torque: Array = np.zeros(3)
        self._strength = 0.0

    @property
    def holds(self) -> bool:
        """Whether there is soil that resists or bears."""
        return self._strength > 0.0 or self.borne.holds

    @property
    def state(self) -> Array:
        """All that the next steps depend on, for a digest."""
        parts = (self._point, self._force, self._torque)
        return np.concatenate([*parts, [self._age], self.borne.state])

    def hear(self, rows: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            rows: FORCE rows of the tool, shape (n,), n >= 1.
            pose: of the drum's frame that does not spin, at the end of that tick.

        Raises:
            MachineError: a wrench that is not finite; what was known before stays.
        """
        milled = rows[rows["holds"] == Holds.MILL]
        if milled.size == 0:
            self.borne.hear(rows, pose)
            self._age = 0
            self._clear()
            return
        place, force, torque = (
            np.array([float(milled[0][name]) for name in names]) for names in _FIELDS
        )
        if not np.isfinite(np.concatenate([place, force, torque])).all():
            raise MachineError(f"the soil's wrench on the drum is {milled[0]}; give finite numbers")
        self._age = 0
        self.borne.forget()  # what bore it while it stood is milled away
        self._point = pose[0].T @ (place - pose[1])
        self._force, self._torque = force, torque
        self._strength = math.sqrt(float(force @ force + torque @ torque))

    def tick(self) -> None:
        """Begin a tick: a wrench that is no longer heard of lapses."""
        self._age += 1
        if self._age > LAPSE:
            self._clear()
        self.borne.tick()

    def forget(self) -> None:
        """Nothing resists until the next answer."""
        self.borne.forget()
        self._clear()

    def step(self, pose: Pose, velocity: tuple[Array, Array], dt: float) -> tuple[Array, Array]:
        """The wrench of the next physics step.

        Args:
            pose: of the drum's frame that does not spin.
            velocity: of its origin [m/s], and angular of the drum [rad/s], map axes.
            dt: physics step [s].

        Returns:
            Force [N] and torque about the frame's origin [N m], map axes.
        """
        axis = pose[0][:, 1]
        spin = float(velocity[1] @ axis)
        force, torque = self.borne.step(pose, (velocity[0], velocity[1] - spin * axis), dt)
        arm = pose[0] @ self._point
        against = -float((self._torque + cross(arm, self._force)) @ axis)
        share = 0.0
        if against * spin > 0.0:
            share = min(1.0, self._brakes * spin / against)
        milled = share * self._force
        return force + milled, torque + share * self._torque + cross(arm, milled)

    def _clear(self) -> None:
        self._point, self._force, self._torque = np.zeros((3, 3))
        self._strength = 0.0
