"""Milling resistance: the torque and thrust of the soil on a spinning drum with picks.

The soil answers a tick with the wrench on the picks in that tick. It arrives one or two ticks
later and applies until the next one. It brakes the drum and never drives it: the active fraction
is limited so that the drum loses at most `_MAX_BRAKING_FRACTION` of its speed in a step, and is
zero for a drum that stands or spins the other way. A drum stalls in this way. A drum at rest is
supported by the soil like any other tool (`machine_sim.tool_soil.resistance`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineError
from machine_sim.machine.rotations import cross
from machine_sim.tool_soil.resistance import FORCE_TIMEOUT_TICKS, SoilResistance
from msg_bridge.contract.rows import Rows, SoilReaction

__all__ = ["MIN_MILLING_SPEED", "MillingResistance"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

MIN_MILLING_SPEED = 0.5
"""Minimum angular speed [rad/s] at which a drum mills."""

_MAX_BRAKING_FRACTION = 0.3
"""Maximum fraction of its angular velocity that a drum loses in a step."""

_WRENCH_FIELDS = (("x", "y", "z"), ("fx", "fy", "fz"), ("tx", "ty", "tz"))


class MillingResistance:
    """Resistance of the soil to one drum.

    Attributes:
        static_resistance: resistance while the drum does not mill.
    """

    def __init__(self, tool_mass: float, machine_mass: float, inertia: float, dt: float) -> None:
        """
        Args:
            tool_mass: mass of the drum's link [kg].
            machine_mass: mass of the whole machine [kg].
            inertia: of the drum about its axis [kg m^2].
            dt: physics step [s].
        """
        self._max_torque_per_speed = _MAX_BRAKING_FRACTION * inertia / dt  # [N m s/rad]
        self.static_resistance = SoilResistance(tool_mass, machine_mass, dt)
        self._ticks_since_update = 0
        self._local_point: Array = np.zeros(3)
        self._force: Array = np.zeros(3)
        self._torque: Array = np.zeros(3)
        self._magnitude = 0.0

    @property
    def is_active(self) -> bool:
        """Whether soil resists or supports the drum."""
        return self._magnitude > 0.0 or self.static_resistance.is_active

    @property
    def state(self) -> Array:
        """All values that the next steps depend on, for the state hash."""
        vectors = (self._local_point, self._force, self._torque)
        return np.concatenate([*vectors, [self._ticks_since_update], self.static_resistance.state])

    def receive(self, rows: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            rows: FORCE rows of the tool, shape (n,), n >= 1.
            pose: of the drum's non-spinning frame at the end of that tick.

        Raises:
            MachineError: a wrench that is not finite; the previous wrench stays in force.
        """
        milling = rows[rows["reaction"] == SoilReaction.MILL]
        if milling.size == 0:
            self.static_resistance.receive(rows, pose)
            self._ticks_since_update = 0
            self._reset_wrench()
            return
        point, force, torque = (
            np.array([float(milling[0][name]) for name in names]) for names in _WRENCH_FIELDS
        )
        if not np.isfinite(np.concatenate([point, force, torque])).all():
            raise MachineError(f"the FORCE row of the drum is {milling[0]}; give finite numbers")
        self._ticks_since_update = 0
        self.static_resistance.reset()  # the soil that supported the drum is milled away
        self._local_point = pose[0].T @ (point - pose[1])
        self._force, self._torque = force, torque
        self._magnitude = math.sqrt(float(force @ force + torque @ torque))

    def begin_tick(self) -> None:
        """Begin a tick: remove a wrench that was not updated for `FORCE_TIMEOUT_TICKS`."""
        self._ticks_since_update += 1
        if self._ticks_since_update > FORCE_TIMEOUT_TICKS:
            self._reset_wrench()
        self.static_resistance.begin_tick()

    def reset(self) -> None:
        """Remove all wrenches until the next FORCE rows."""
        self.static_resistance.reset()
        self._reset_wrench()

    def step(self, pose: Pose, velocity: tuple[Array, Array], dt: float) -> tuple[Array, Array]:
        """Return the wrench of the next physics step.

        Args:
            pose: of the drum's non-spinning frame.
            velocity: of its origin [m/s], and angular of the drum [rad/s], map axes.
            dt: physics step [s].

        Returns:
            Force [N] and torque about the frame's origin [N m], map axes.
        """
        axis = pose[0][:, 1]
        drum_speed = float(velocity[1] @ axis)
        force, torque = self.static_resistance.step(
            pose, (velocity[0], velocity[1] - drum_speed * axis), dt
        )
        lever_arm = pose[0] @ self._local_point
        braking_torque = -float((self._torque + cross(lever_arm, self._force)) @ axis)
        active_fraction = 0.0
        if braking_torque * drum_speed > 0.0:
            active_fraction = min(1.0, self._max_torque_per_speed * drum_speed / braking_torque)
        milling_force = active_fraction * self._force
        return (
            force + milling_force,
            torque + active_fraction * self._torque + cross(lever_arm, milling_force),
        )

    def _reset_wrench(self) -> None:
        self._local_point, self._force, self._torque = np.zeros((3, 3))
        self._magnitude = 0.0
