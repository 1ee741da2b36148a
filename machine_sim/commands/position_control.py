"""Position control: the velocity that moves a joint to an angle and holds it there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # at run time the import would load the physics engine
    from machine_sim.machine.spec import JointLimits

__all__ = ["POSITION_TOLERANCE", "velocity_to_target"]

POSITION_TOLERANCE = 1e-4
"""Distance from the target within which the velocity is zero [rad]."""

_BRAKING_FRACTION = 0.5
"""Fraction of the joint's acceleration used for braking; the rest compensates a tick of delay."""

_GAIN = 5.0
"""Velocity per distance near the target [1/s]; no overshoot at ticks up to 50 ms, nor with a valve
that responds within 50 ms."""


def velocity_to_target(target: float, angle: float, limits: JointLimits) -> float:
    """Return the velocity [rad/s] to command now.

    A joint that starts at rest does not overshoot. A continuous joint turns in the shorter
    direction.

    Args:
        target, angle: target and present angle [rad].
        limits: limits of the joint.
    """
    error = target - angle
    if math.isinf(limits.upper):
        error = math.remainder(error, 2.0 * math.pi)
    distance = abs(error)
    if distance <= POSITION_TOLERANCE:
        return 0.0
    braking = math.sqrt(2.0 * _BRAKING_FRACTION * limits.max_acceleration * distance)
    return math.copysign(min(limits.max_velocity, braking, _GAIN * distance), error)
