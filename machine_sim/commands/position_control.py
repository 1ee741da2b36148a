"""The velocity that brings a joint to an angle and keeps it there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # at run time the machine's package would load the physics engine
    from machine_sim.machine.spec import JointLimits

__all__ = ["POSITION_TOLERANCE", "velocity_to_target"]

POSITION_TOLERANCE = 1e-4
"""Distance from the goal at which a joint is there [rad]."""

_BRAKING_FRACTION = 0.5
"""Part of the joint's acceleration to brake with: the rest is for what a tick of delay adds."""

_GAIN = 8.0
"""Velocity for a distance near the goal [1/s]: low enough not to overshoot in ticks up to 50 ms."""


def velocity_to_target(goal: float, angle: float, limits: JointLimits) -> float:
    """Velocity [rad/s] to command now; depends on nothing but the arguments.

    A joint that stands still at the start does not overshoot. A continuous joint takes the shorter
    way around.

    Args:
        goal, angle: where the joint shall be and where it is [rad].
        limits: what the joint can do.
    """
    way = goal - angle
    if math.isinf(limits.upper):
        way = math.remainder(way, 2.0 * math.pi)
    distance = abs(way)
    if distance <= POSITION_TOLERANCE:
        return 0.0
    braking = math.sqrt(2.0 * _BRAKING_FRACTION * limits.max_acceleration * distance)
    return math.copysign(min(limits.max_velocity, braking, _GAIN * distance), way)
