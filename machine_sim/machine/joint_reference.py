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

from machine_sim.machine.joint_table import (
    ANGLE,
    COMMAND,
    END_DECELERATION,
    HAS_MOTOR,
    IS_HOLDING,
    LOWER,
    MAX_ACCELERATION,
    MAX_VELOCITY,
    RATE,
    TARGET_ANGLE,
    TARGET_RATE,
    UPPER,
    joint_table,
)
from machine_sim.machine.spec import JointLimits
from msg_bridge.kernels import helper, kernel

__all__ = ["MAX_REFERENCE_LEAD", "JointReference", "advance_references"]

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
        table: table of the joints, see `joint_table`.
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
        self.table = joint_table(limits, list(motor_joints))
        self.table[TARGET_ANGLE] = home

    @property
    def angle(self) -> list[float]:
        """Reference angles [rad]."""
        return _row(self.table, TARGET_ANGLE)

    @property
    def rate(self) -> list[float]:
        """Reference speeds [rad/s]."""
        return _row(self.table, TARGET_RATE)

    @property
    def command(self) -> list[float]:
        """Commanded speeds [rad/s]."""
        return _row(self.table, COMMAND)

    @command.setter
    def command(self, speeds: Sequence[float]) -> None:
        self.table[COMMAND] = speeds

    def advance(self, dt: float, actual: Sequence[float], rates: Sequence[float]) -> None:
        """Advance the reference by `dt` [s].

        Args:
            dt: time step [s].
            actual: actual angles of the joints [rad].
            rates: actual speeds of the joints [rad/s].
        """
        self.table[ANGLE], self.table[RATE] = actual, rates
        _advance(dt, self.table)


def _row(table: NDArray[np.float64], slot: int) -> list[float]:
    values: list[float] = table[slot].tolist()
    return values


@kernel
def _advance(dt, joints):  # type: ignore[no-untyped-def]
    """Run `advance_references` alone."""
    advance_references(dt, joints)


@helper
def advance_references(dt, joints):  # type: ignore[no-untyped-def]
    """Advance the references of all joints by a time step.

    Args:
        dt: time step [s].
        joints: table of the joints, see `joint_table`; its target angles and rates are updated.
    """
    for i in range(joints.shape[1]):
        rate, angle = joints[TARGET_RATE, i], joints[TARGET_ANGLE, i]
        actual, max_velocity = joints[ANGLE, i], joints[MAX_VELOCITY, i]
        lower, upper = joints[LOWER, i], joints[UPPER, i]
        step, end_step = joints[MAX_ACCELERATION, i] * dt, joints[END_DECELERATION, i] * dt
        target_rate = min(max(joints[COMMAND, i], -max_velocity), max_velocity)
        rate = min(max(target_rate, rate - step), rate + step)
        if rate > 0.0:
            rate = min(rate, _max_stopping_rate(upper - angle, end_step, dt))
        elif rate < 0.0:
            rate = max(rate, -_max_stopping_rate(angle - lower, end_step, dt))
        if joints[HAS_MOTOR, i] and not (joints[IS_HOLDING, i] and rate == 0.0):
            actual_rate = joints[RATE, i]
            rate = min(max(rate, actual_rate - MAX_RATE_LEAD), actual_rate + MAX_RATE_LEAD)
            joints[IS_HOLDING, i] = rate == 0.0 and abs(actual_rate) <= _REST_RATE
            if not joints[IS_HOLDING, i]:
                # Without an angle error the position control follows the speed alone.
                angle = actual - rate * dt
        angle += rate * dt
        angle = min(max(angle, actual - MAX_REFERENCE_LEAD), actual + MAX_REFERENCE_LEAD)
        joints[TARGET_ANGLE, i] = min(max(angle, lower), upper)
        joints[TARGET_RATE, i] = rate


@helper
def _max_stopping_rate(distance, step, dt):  # type: ignore[no-untyped-def]
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
