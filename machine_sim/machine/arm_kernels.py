"""Kernel helpers of an excavator's arm: joint angles for a position of the bucket pin."""

from __future__ import annotations

import math
from typing import NamedTuple

from machine_sim.machine.box import Vec3
from msg_bridge.kernels import helper

__all__ = [
    "ARM_LIMIT",
    "BOOM_LIMIT",
    "LIMIT_TOLERANCE",
    "NO_FAULT",
    "OUT_OF_REACH",
    "ArmTable",
    "remainder",
    "solve_pin_angles",
]

NO_FAULT, OUT_OF_REACH, BOOM_LIMIT, ARM_LIMIT = range(4)
"""Results of `solve_pin_angles`: a solution, a pin that is too far or too near, and a boom or an
arm beyond its limits."""

LIMIT_TOLERANCE = 1e-9
"""Tolerance for rounding when an angle is compared with its limits [rad]."""


class ArmTable(NamedTuple):
    """Geometry and limits of an excavator's arm, for kernels.

    Attributes:
        swing: position of the swing bearing in the base frame [m].
        foot_x, foot_z: position of the boom pin in the swing frame [m].
        boom, arm: lengths from pin to pin [m].
        boom_limits, arm_limits, bucket_limits: lower and upper limits of the joints [rad].
    """

    swing: Vec3
    foot_x: float
    foot_z: float
    boom: float
    arm: float
    boom_limits: tuple[float, float]
    arm_limits: tuple[float, float]
    bucket_limits: tuple[float, float]


@helper
def solve_pin_angles(geometry, reach, height):  # type: ignore[no-untyped-def]
    """Return one of the results above, and the boom and arm angles [rad].

    Args:
        geometry: `ArmTable`.
        reach, height: position of the bucket pin in the swing frame [m].
    """
    first, second = geometry.boom, geometry.arm
    r, z = reach - geometry.foot_x, height - geometry.foot_z
    cosine = (r * r + z * z - first * first - second * second) / (2.0 * first * second)
    if not -1.0 <= cosine <= 1.0:
        return OUT_OF_REACH, 0.0, 0.0
    arm = math.acos(cosine)
    boom = math.atan2(-z, r) - math.atan2(second * math.sin(arm), first + second * cosine)
    boom = remainder(boom, 2.0 * math.pi)
    if not _is_within(boom, geometry.boom_limits):
        return BOOM_LIMIT, boom, arm
    if not _is_within(arm, geometry.arm_limits):
        return ARM_LIMIT, boom, arm
    return NO_FAULT, _clamped(boom, geometry.boom_limits), _clamped(arm, geometry.arm_limits)


@helper
def _is_within(angle, limits):  # type: ignore[no-untyped-def]
    return limits[0] - LIMIT_TOLERANCE <= angle <= limits[1] + LIMIT_TOLERANCE


@helper
def _clamped(angle, limits):  # type: ignore[no-untyped-def]
    return min(max(angle, limits[0]), limits[1])


@helper
def remainder(x, y):  # type: ignore[no-untyped-def]
    """Return `math.remainder`, which kernels lack, by the exact steps of CPython; y > 0."""
    size = abs(x)
    rest = size % y  # exact, as `math.fmod` of positive numbers
    beyond = y - rest
    if rest > beyond:
        rest = -beyond
    elif rest == beyond:  # halfway: the even multiple
        rest -= 2.0 * (0.5 * (size - rest) % y)
    return math.copysign(1.0, x) * rest
