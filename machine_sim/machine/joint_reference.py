"""Reference motion of the arm's joints: commanded speeds become ramps that end at the limits.

Every joint follows a reference angle. It moves with a speed that ramps toward the command, brakes
in time for the joint's limit, and stands still at zero command, so that following it is also what
holds the arm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.spec import JointLimits

__all__ = ["MAX_REFERENCE_LEAD", "JointReference"]

MAX_REFERENCE_LEAD = 0.01
"""Furthest the reference goes from the real angle [rad].

A joint that is too weak (soil too hard, relief valve open) is not wound up: it goes on, or stays,
from where it is.
"""


class JointReference:
    """Reference angles and speeds of a machine's joints.

    Attributes:
        angle: reference angles [rad].
        rate: reference speeds [rad/s].
        command: wanted speeds [rad/s].
    """

    def __init__(self, limits: Sequence[JointLimits], home: NDArray[np.float64]) -> None:
        """
        Args:
            limits: of each joint.
            home: angles to start with [rad].
        """
        self._limits = tuple(limits)
        self.angle: list[float] = home.tolist()
        self.rate: list[float] = [0.0] * len(self._limits)
        self.command: list[float] = [0.0] * len(self._limits)

    def advance(self, dt: float, actual: Sequence[float]) -> None:
        """Move the reference by `dt` [s]; `actual` are the joints' real angles [rad]."""
        for i, limit in enumerate(self._limits):
            rate, angle = self.rate[i], self.angle[i]
            step = limit.acceleration * dt
            wanted = min(max(self.command[i], -limit.speed), limit.speed)
            rate = min(max(wanted, rate - step), rate + step)
            if rate > 0.0:
                rate = min(rate, _max_stopping_rate(limit.upper - angle, step, dt))
            elif rate < 0.0:
                rate = max(rate, -_max_stopping_rate(angle - limit.lower, step, dt))
            angle += rate * dt
            angle = min(max(angle, actual[i] - MAX_REFERENCE_LEAD), actual[i] + MAX_REFERENCE_LEAD)
            self.angle[i] = min(max(angle, limit.lower), limit.upper)
            self.rate[i] = rate


def _max_stopping_rate(room: float, step: float, dt: float) -> float:
    """Greatest speed [rad/s] from which steps of `step` [rad/s] stop within `room` [rad]."""
    if math.isinf(room):
        return math.inf
    if room <= 0.0:
        return 0.0
    # Speeds v, v - step, v - 2 step ... over dt each add up to v (v + step) dt / (2 step).
    rate = 0.5 * step * (math.sqrt(1.0 + 8.0 * room / (step * dt)) - 1.0)
    return min(rate, room / dt)
