"""Joints of a machine as a table for kernels: limits, present motion, and the next motor targets.

A table has one row for each slot below and one column for each joint, in the order of the
specification: kernels take few arrays faster than many.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.spec import JointLimits

__all__ = [
    "ANGLE",
    "COMMAND",
    "EFFORT",
    "END_DECELERATION",
    "HAS_MOTOR",
    "IS_HOLDING",
    "LOWER",
    "MAX_ACCELERATION",
    "MAX_EFFORT",
    "MAX_VELOCITY",
    "RATE",
    "TARGET_ANGLE",
    "TARGET_RATE",
    "TORQUE_LIMIT",
    "UPPER",
    "joint_table",
]

Array = NDArray[np.float64]

LOWER, UPPER, MAX_VELOCITY, MAX_ACCELERATION, MAX_EFFORT = range(5)
"""Rows of the limits: angles [rad], speed [rad/s], acceleration [rad/s^2], torque [N m]."""

HAS_MOTOR = 5
"""Row of 1.0 for a joint with a hydraulic motor, else 0.0."""

ANGLE, RATE, EFFORT = range(6, 9)
"""Rows of the present motion [rad], [rad/s], and of the torque of the last step [N m]."""

COMMAND = 9
"""Row of the commanded speeds of the references [rad/s]."""

TARGET_ANGLE, TARGET_RATE, TORQUE_LIMIT = range(10, 13)
"""Rows of the references [rad], [rad/s], and of the maximum torque in the next step [N m]."""

IS_HOLDING = 13
"""Row of 1.0 for a joint whose motor has come to rest and holds its angle, else 0.0."""

END_DECELERATION = 14
"""Row of the maximum deceleration before an angle limit [rad/s^2]."""

_NUM_SLOTS = 15


def joint_table(limits: Sequence[JointLimits], motor_joints: Sequence[int] = ()) -> Array:
    """Return the table of joints at rest at angle 0, all of which hold their angles.

    Args:
        limits: limits of each joint.
        motor_joints: indices of the joints with a hydraulic motor.
    """
    table = np.zeros((_NUM_SLOTS, len(limits)))
    for i, limit in enumerate(limits):
        table[: MAX_EFFORT + 1, i] = (
            limit.lower,
            limit.upper,
            limit.max_velocity,
            limit.max_acceleration,
            limit.max_effort,
        )
        table[END_DECELERATION, i] = limit.end_deceleration
    table[HAS_MOTOR, list(motor_joints)] = 1.0
    table[IS_HOLDING] = 1.0
    return table
