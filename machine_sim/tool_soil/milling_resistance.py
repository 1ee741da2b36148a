"""The soil as a drum with picks feels it: it takes torque and thrust while the drum spins in it.

The soil answers a tick with the wrench of what the picks cut then; it comes a tick or two later,
and acts until the next. It never drives: where it would stop the drum within a step or two, as much
of it acts as brakes what spin there is, and none against a drum that stands or turns the other way.
That is a drum that stalls. One that stands in soil is borne by it like any other tool
(`machine_sim.tool_soil.resistance`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineError
from machine_sim.machine.arm_kinematics import cross
from machine_sim.tool_soil.resistance import FORCE_TIMEOUT_TICKS, SoilResistance
from msg_bridge.contract.rows import Rows, SoilReaction

__all__ = ["MIN_MILLING_SPEED", "MillingResistance"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

MIN_MILLING_SPEED = 0.5
"""Spin [rad/s] from which on a drum cuts."""

_MAX_BRAKING_FRACTION = 0.3
"""Part of its spin that a drum can lose in a step."""

_WRENCH_FIELDS = (("x", "y", "z"), ("fx", "fy", "fz"), ("tx", "ty", "tz"))


class MillingResistance:
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
        self._max_torque_per_speed = _MAX_BRAKING_FRACTION * inertia / dt  # torque over spin
        self.static_resistance = SoilResistance(tool_mass, machine_mass, dt)
        self._ticks_since_update = 0
        self._local_point: Array = np.zeros(3)
        self._force: Array = np.zeros(3)
        self._torque: Array = np.zeros(3)
        self._magnitude = 0.0

    @property
    def is_active(self) -> bool:
        """Whether there is soil that resists or bears."""
        return self._magnitude > 0.0 or self.static_resistance.is_active

    @property
    def state(self) -> Array:
        """All that the next steps depend on, for a digest."""
        parts = (self._local_point, self._force, self._torque)
        return np.concatenate([*parts, [self._ticks_since_update], self.static_resistance.state])

    def receive(self, rows: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            rows: FORCE rows of the tool, shape (n,), n >= 1.
            pose: of the drum's frame that does not spin, at the end of that tick.

        Raises:
            MachineError: a wrench that is not finite; what was known before stays.
        """
        milled = rows[rows["reaction"] == SoilReaction.MILL]
        if milled.size == 0:
            self.static_resistance.receive(rows, pose)
            self._ticks_since_update = 0
            self._reset_wrench()
            return
        place, force, torque = (
            np.array([float(milled[0][name]) for name in names]) for names in _WRENCH_FIELDS
        )
        if not np.isfinite(np.concatenate([place, force, torque])).all():
            raise MachineError(f"the soil's wrench on the drum is {milled[0]}; give finite numbers")
        self._ticks_since_update = 0
        self.static_resistance.reset()  # what bore it while it stood is milled away
        self._local_point = pose[0].T @ (place - pose[1])
        self._force, self._torque = force, torque
        self._magnitude = math.sqrt(float(force @ force + torque @ torque))

    def begin_tick(self) -> None:
        """Begin a tick: a wrench that is no longer heard of lapses."""
        self._ticks_since_update += 1
        if self._ticks_since_update > FORCE_TIMEOUT_TICKS:
            self._reset_wrench()
        self.static_resistance.begin_tick()

    def reset(self) -> None:
        """Nothing resists until the next answer."""
        self.static_resistance.reset()
        self._reset_wrench()

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
        force, torque = self.static_resistance.step(
            pose, (velocity[0], velocity[1] - spin * axis), dt
        )
        arm = pose[0] @ self._local_point
        against = -float((self._torque + cross(arm, self._force)) @ axis)
        share = 0.0
        if against * spin > 0.0:
            share = min(1.0, self._max_torque_per_speed * spin / against)
        milled = share * self._force
        return force + milled, torque + share * self._torque + cross(arm, milled)

    def _reset_wrench(self) -> None:
        self._local_point, self._force, self._torque = np.zeros((3, 3))
        self._magnitude = 0.0
