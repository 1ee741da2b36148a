"""Length and lever arm of cylinders in kernels, as `CylinderLinkage.length_and_lever_arm`."""

from __future__ import annotations

import math

from machine_sim.machine.hydraulic_tables import (
    BARREL_X,
    BARREL_Z,
    COUPLER_LENGTH,
    COUPLER_X,
    COUPLER_Z,
    JOINT_X,
    JOINT_Z,
    LOWER,
    PIN_X,
    PIN_Z,
    ROCKER_LENGTH,
    ROD_X,
    ROD_Z,
    UPPER,
)
from msg_bridge.kernels import helper

__all__ = ["length_and_lever_arm"]

_SPLIT = 2.0**27 + 1.0
"""Factor that splits a float64 into two halves of 26 bits (Dekker 1971)."""


@helper
def length_and_lever_arm(cylinder, angle):  # type: ignore[no-untyped-def]
    """Return length [m] and lever arm [m/rad] of a cylinder, at the nearest angle in its range.

    Args:
        cylinder: row of the table of cylinders.
        angle: joint angle [rad].
    """
    angle = min(max(angle, cylinder[LOWER]), cylinder[UPPER])
    joint, barrel = (cylinder[JOINT_X], cylinder[JOINT_Z]), (cylinder[BARREL_X], cylinder[BARREL_Z])
    if not math.isnan(cylinder[ROD_X]):
        rod = _in_parent_frame(joint, (cylinder[ROD_X], cylinder[ROD_Z]), angle)
        motion = _motion_per_angle(joint, rod)
    else:
        pin = (cylinder[PIN_X], cylinder[PIN_Z])
        coupler_pin = _in_parent_frame(joint, (cylinder[COUPLER_X], cylinder[COUPLER_Z]), angle)
        rod = _rocker_end(
            pin, cylinder[ROCKER_LENGTH], coupler_pin, cylinder[COUPLER_LENGTH], joint
        )
        circular, coupler = _motion_per_angle(pin, rod), _difference(rod, coupler_pin)
        projection = _dot(coupler, circular)
        if projection == 0.0:
            return _norm(_difference(barrel, rod)), math.inf
        ratio = _dot(coupler, _motion_per_angle(joint, coupler_pin)) / projection
        motion = (ratio * circular[0], ratio * circular[1])
    length = _norm(_difference(barrel, rod))
    return length, _dot(_difference(rod, barrel), motion) / length


@helper
def _in_parent_frame(joint, point, angle):  # type: ignore[no-untyped-def]
    """Transform a point from the frame of the child link to that of the parent link."""
    s, c = math.sin(angle), math.cos(angle)
    return joint[0] + c * point[0] + s * point[1], joint[1] - s * point[0] + c * point[1]


@helper
def _difference(a, b):  # type: ignore[no-untyped-def]
    return a[0] - b[0], a[1] - b[1]


@helper
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1]


@helper
def _motion_per_angle(pin, point):  # type: ignore[no-untyped-def]
    """Return the derivative of a point's position by a rotation about a pin [m/rad]."""
    x, z = _difference(point, pin)
    return z, -x


@helper
def _rocker_end(pin, length, coupler_pin, coupler_length, joint):  # type: ignore[no-untyped-def]
    """Return where rocker and coupler meet, on the side of their pins away from the joint [m]."""
    (ux, uz), (vx, vz) = _difference(coupler_pin, pin), _difference(joint, pin)
    side = -math.copysign(1.0, ux * vz - uz * vx)
    distance = _norm(_difference(pin, coupler_pin))
    along = (length * length - coupler_length * coupler_length + distance * distance) / (
        2.0 * distance
    )
    across = side * math.sqrt(max(length * length - along * along, 0.0))
    ux, uz = ux / distance, uz / distance
    return pin[0] + along * ux - across * uz, pin[1] + along * uz + across * ux


@helper
def _norm(vector):  # type: ignore[no-untyped-def]
    """Return the length of a vector, rounded correctly as `math.dist` does.

    Kernels and Python have to agree on the geometry of a linkage to the last bit.
    """
    a, b = max(abs(vector[0]), abs(vector[1])), min(abs(vector[0]), abs(vector[1]))
    norm = math.sqrt(a * a + b * b)
    if norm == 0.0:
        return 0.0
    excess = ((a * a - norm * norm) + b * b) + (
        _product_error(a) + _product_error(b) - _product_error(norm)
    )
    return norm + excess / (2.0 * norm)


@helper
def _product_error(a):  # type: ignore[no-untyped-def]
    """Return what the rounding of a * a has removed."""
    high = a * _SPLIT
    high -= high - a
    low = a - high
    return ((high * high - a * a) + 2.0 * high * low) + low * low
