"""Motion of a machine as it is reported: velocities by the clock, also if ticks were skipped.

With `overload: skip_ticks` a machine on a slow computer makes fewer ticks than simulation time has.
In each it moves by its velocity times the tick period, so over a time it moves by only that
fraction of its velocity. It is the distance moved over the time passed that is reported.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import TrackedMachine

__all__ = ["ReportedMotion", "TickProgress", "VelocityScale"]

Array = NDArray[np.float64]


class TickProgress(NamedTuple):
    """Number of ticks that a machine made, and of ticks of simulation time that passed."""

    made: int
    passed: int

    def after_tick(self, interval: int) -> TickProgress:
        """Return the progress after one more tick, in which `interval` ticks have passed."""
        return TickProgress(self.made + 1, self.passed + interval)


class VelocityScale:
    """Fraction of the ticks that were made between two publications.

    Attributes:
        value: fraction between the last two publications, 0 to 1.
    """

    def __init__(self) -> None:
        self.value = 1.0
        self._last: TickProgress | None = None

    def update(self, progress: TickProgress) -> float:
        """Return the fraction since the last call; that of the last call without a tick since."""
        last, self._last = self._last, progress
        if last is not None and progress.passed > last.passed:
            self.value = (progress.made - last.made) / (progress.passed - last.passed)
        return self.value


class ReportedMotion(NamedTuple):
    """Pose and velocities of a machine.

    Attributes:
        base_pose: position [m] and quaternion x, y, z, w of the base.
        base_velocity: velocity [m/s] and angular velocity [rad/s] of the base, map frame.
        joint_positions: angles [rad], shape (joints,).
        joint_velocities: [rad/s], shape (joints,).
    """

    base_pose: tuple[Array, Array]
    base_velocity: tuple[Array, Array]
    joint_positions: Array
    joint_velocities: Array

    @classmethod
    def of_machine(cls, machine: TrackedMachine, scale: float) -> ReportedMotion:
        """Return the motion of a machine with all velocities multiplied by `scale`."""
        linear, angular = machine.base_velocity
        return cls(
            machine.base_pose,
            (scale * linear, scale * angular),
            machine.joint_positions,
            scale * machine.joint_velocities,
        )
