"""Reference motion of the joints: speed commands become ramps that stop at the joint limits.

Each joint follows a reference angle. The reference speed ramps toward the command, brakes in time
for the joint limit, and is zero at zero command, so that the position control also holds the arm.

A joint with a hydraulic motor has limited torque and a large inertia. Its reference is a speed near
the actual one, while it turns; the angle at which it comes to rest is the one that it holds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.spec import JointLimits

__all__ = ["MAX_REFERENCE_LEAD", "JointReference"]

MAX_REFERENCE_LEAD = 0.01
"""Maximum distance between the reference and the actual angle [rad].

It prevents wind-up: a joint that cannot follow (soil too hard, relief valve open) resumes from its
actual angle.
"""

MAX_RATE_LEAD = 0.05
"""Maximum difference between the reference and the actual speed of a joint with a motor [rad/s].

Without it a lever in neutral would let the motor accelerate until the reference speed, which ran
ahead, had come down to the actual one.
"""

_REST_RATE = 0.01
"""Speed below which a joint with a motor is at rest and holds its angle [rad/s]."""


class JointReference:
    """Reference angles and speeds of a machine's joints.

    Attributes:
        angle: reference angles [rad].
        rate: reference speeds [rad/s].
        command: commanded speeds [rad/s].
        is_holding: whether each joint with a motor has come to rest and holds its angle.
    """

    def __init__(
        self,
        limits: Sequence[JointLimits],
        home: NDArray[np.float64],
        motor_joints: Collection[int] = (),
    ) -> None:
        """
        Args:
            limits: limits of each joint.
            home: initial angles [rad], shape (joints,).
            motor_joints: indices of the joints with a hydraulic motor.
        """
        self._limits = tuple(limits)
        self._has_motor = [i in motor_joints for i in range(len(self._limits))]
        self.angle: list[float] = home.tolist()
        self.rate: list[float] = [0.0] * len(self._limits)
        self.command: list[float] = [0.0] * len(self._limits)
        self.is_holding = [True] * len(self._limits)

    def advance(self, dt: float, actual: Sequence[float], rates: Sequence[float]) -> None:
        """Advance the reference by `dt` [s].

        Args:
            dt: time step [s].
            actual: actual angles of the joints [rad].
            rates: actual speeds of the joints [rad/s].
        """
        for i, limit in enumerate(self._limits):
            rate, angle = self.rate[i], self.angle[i]
            step = limit.max_acceleration * dt
            target_rate = min(max(self.command[i], -limit.max_velocity), limit.max_velocity)
            rate = min(max(target_rate, rate - step), rate + step)
            if rate > 0.0:
                rate = min(rate, _max_stopping_rate(limit.upper - angle, step, dt))
            elif rate < 0.0:
                rate = max(rate, -_max_stopping_rate(angle - limit.lower, step, dt))
            if self._has_motor[i] and not (self.is_holding[i] and rate == 0.0):
                rate = min(max(rate, rates[i] - MAX_RATE_LEAD), rates[i] + MAX_RATE_LEAD)
                self.is_holding[i] = rate == 0.0 and abs(rates[i]) <= _REST_RATE
                if not self.is_holding[i]:
                    # Without an angle error the position control follows the speed alone.
                    angle = actual[i] - rate * dt
            angle += rate * dt
            angle = min(max(angle, actual[i] - MAX_REFERENCE_LEAD), actual[i] + MAX_REFERENCE_LEAD)
            self.angle[i] = min(max(angle, limit.lower), limit.upper)
            self.rate[i] = rate


def _max_stopping_rate(distance: float, step: float, dt: float) -> float:
    """Return the maximum speed [rad/s] from which steps of `step` [rad/s] stop in time.

    Args:
        distance: distance to the joint limit [rad].
        step: change of speed in one time step [rad/s].
        dt: time step [s].
    """
    if math.isinf(distance):
        return math.inf
    if distance <= 0.0:
        return 0.0
    # Speeds v, v - step, v - 2 step ... over dt each add up to v (v + step) dt / (2 step).
    rate = 0.5 * step * (math.sqrt(1.0 + 8.0 * distance / (step * dt)) - 1.0)
    return min(rate, distance / dt)
