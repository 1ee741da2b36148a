"""Kinematics of a cylinder and its joint: angle to cylinder length and back, in closed form.

All points are in the arm plane, in the frame of the link that carries the barrel (the parent of the
joint): x forward, z up. The joint angle q is a rotation about +y, from x toward -z. The rod is
pinned to the child link of the joint, or, where the joint's range is too large for that, to a
rocker: a lever pinned to the parent link, whose end a coupler connects to the child link. That is a
four-bar linkage; on an excavator it drives the bucket::

      barrel ====== S            S: end of the rocker, pin of rod and coupler
                   / \\
          rocker  /   \\ coupler
                 o     \\
               pin  O---T        O: joint;  T: pin of the coupler on the child link
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from machine_sim.machine.errors import MachineError

__all__ = ["CylinderLinkage", "LinkagePins", "Point", "Rocker"]

Point = tuple[float, float]
"""x, z [m]."""

_MIN_LEVER_ARM = 1e-3
"""Lever arm below which a cylinder is at a dead centre and cannot move the joint [m]."""
_NUM_CHECKED_ANGLES = 200
"""Number of intervals in the range of the joint at whose ends a linkage is validated."""


@dataclass(frozen=True)
class Rocker:
    """Lever and coupler between a cylinder and a joint with a large range.

    Attributes:
        pin: pin of the rocker on the parent link, in its frame [m].
        length: length of the rocker from that pin to its end [m].
        coupler_length: length of the coupler from the rocker's end to `coupler_pin` [m].
        coupler_pin: pin of the coupler on the child link, in the child's frame [m].
    """

    pin: Point
    length: float
    coupler_length: float
    coupler_pin: Point


class LinkagePins(NamedTuple):
    """Positions of the pins in the parent link's frame [m]; `coupler_pin` only with a rocker."""

    barrel: Point
    rod: Point
    coupler_pin: Point | None


@dataclass(frozen=True)
class CylinderLinkage:
    """Geometry of a cylinder and the joint that it drives.

    Attributes:
        joint: pin of the joint in the frame of the parent link [m].
        barrel: pin of the barrel in the same frame [m].
        rod: pin of the rod in the frame of the child link [m]; None with a rocker.
        rocker: rocker between rod and child link, or None.
        lower, upper: limits of the joint [rad].
    """

    joint: Point
    barrel: Point
    rod: Point | None
    rocker: Rocker | None
    lower: float
    upper: float

    def __post_init__(self) -> None:
        """
        Raises:
            MachineError: both or neither of rod and rocker, a linkage that does not close at some
                angle within the limits, or a dead centre within the limits.
        """
        if (self.rod is None) == (self.rocker is None):
            raise MachineError("the linkage of a cylinder needs either `rod` or `rocker`; give one")
        step = (self.upper - self.lower) / _NUM_CHECKED_ANGLES
        angles = [self.lower + k * step for k in range(_NUM_CHECKED_ANGLES + 1)]
        lever_arms = [self.lever_arm(angle) for angle in angles]
        for angle, lever_arm in zip(angles, lever_arms, strict=True):
            if abs(lever_arm) < _MIN_LEVER_ARM or (lever_arm > 0.0) != (lever_arms[0] > 0.0):
                raise MachineError(
                    f"the cylinder is at a dead centre at {angle:.3f} rad, where it cannot move the"
                    " joint; move a pin, or narrow the joint's limits"
                )

    @cached_property
    def min_length(self) -> float:
        """Length of the cylinder at the joint limit at which it is retracted [m]."""
        return min(self.length(self.lower), self.length(self.upper))

    @cached_property
    def max_length(self) -> float:
        """Length of the cylinder at the joint limit at which it is extended [m]."""
        return max(self.length(self.lower), self.length(self.upper))

    def pins(self, angle: float) -> LinkagePins:
        """Return the positions of the pins at a joint angle [rad].

        Raises:
            MachineError: rocker and coupler do not reach each other.
        """
        if self.rocker is None:
            assert self.rod is not None
            return LinkagePins(self.barrel, _in_parent_frame(self.joint, self.rod, angle), None)
        coupler_pin = _in_parent_frame(self.joint, self.rocker.coupler_pin, angle)
        # Of the two intersections, the one away from the joint: the four-bar is not crossed.
        end = _circle_intersection(
            self.rocker.pin,
            self.rocker.length,
            coupler_pin,
            self.rocker.coupler_length,
            -_side_of_line(self.rocker.pin, coupler_pin, self.joint),
        )
        if end is None:
            raise MachineError(
                f"rocker and coupler do not reach each other at {angle:.3f} rad; lengthen one, or"
                " narrow the joint's limits"
            )
        return LinkagePins(self.barrel, end, coupler_pin)

    def length(self, angle: float) -> float:
        """Return the length of the cylinder from pin to pin [m] at a joint angle [rad]."""
        return math.dist(self.barrel, self.pins(angle).rod)

    def lever_arm(self, angle: float) -> float:
        """Return dL/dq, cylinder length by joint angle [m/rad], at an angle [rad].

        It is also the lever arm [m]: the joint torque is the cylinder force times dL/dq.
        """
        return self.length_and_lever_arm(angle)[1]

    def length_and_lever_arm(self, angle: float) -> tuple[float, float]:
        """Return `length` and `lever_arm`, with one computation of the pins."""
        barrel, rod, coupler_pin = self.pins(angle)
        length = math.dist(barrel, rod)
        if coupler_pin is None:
            motion = _motion_per_angle(self.joint, rod)
        else:
            # The coupler has a constant length, so its ends have the same speed along it.
            assert self.rocker is not None
            circular = _motion_per_angle(self.rocker.pin, rod)
            coupler = _difference(rod, coupler_pin)
            projection = _dot(coupler, circular)
            if projection == 0.0:
                return length, math.inf
            ratio = _dot(coupler, _motion_per_angle(self.joint, coupler_pin)) / projection
            motion = (ratio * circular[0], ratio * circular[1])
        return length, _dot(_difference(rod, barrel), motion) / length

    def angle(self, length: float) -> float:
        """Return the joint angle [rad] at a cylinder length [m].

        Raises:
            MachineError: the length is outside the range within the joint limits.
        """
        low, high = self.min_length, self.max_length
        if not low - 1e-9 <= length <= high + 1e-9:
            raise MachineError(
                f"cylinder length {length:.4f} m is outside the joint's limits; give {low:.4f} to"
                f" {high:.4f} m"
            )
        middle = 0.5 * (self.lower + self.upper)
        pins = self.pins(middle)
        if self.rocker is None:
            assert self.rod is not None
            return self._angle_of(
                self.rod, self._rod_pin_at(self.joint, math.hypot(*self.rod), length)
            )
        end = self._rod_pin_at(self.rocker.pin, self.rocker.length, length)
        assert pins.coupler_pin is not None
        coupler_pin = _circle_intersection(
            self.joint,
            math.hypot(*self.rocker.coupler_pin),
            end,
            self.rocker.coupler_length,
            _side_of_line(self.joint, pins.rod, pins.coupler_pin),
        )
        assert coupler_pin is not None, "lengths within the limits close the linkage"
        return self._angle_of(self.rocker.coupler_pin, coupler_pin)

    def _rod_pin_at(self, pin: Point, radius: float, length: float) -> Point:
        """Return the pin of the rod on a circle about `pin` at a cylinder length [m].

        Of the two intersections it is the one on the rod's side of the line from barrel to `pin`.
        """
        rod = self.pins(0.5 * (self.lower + self.upper)).rod
        end = _circle_intersection(
            self.barrel, length, pin, radius, _side_of_line(self.barrel, pin, rod)
        )
        assert end is not None, "lengths within the limits close the linkage"
        return end

    def _angle_of(self, at_zero: Point, at: Point) -> float:
        """Return the joint angle [rad] that moves a point of the child link to `at`."""
        x, z = _difference(at, self.joint)
        angle = math.atan2(at_zero[1], at_zero[0]) - math.atan2(z, x)
        middle = 0.5 * (self.lower + self.upper)
        return middle + math.remainder(angle - middle, 2.0 * math.pi)


def _in_parent_frame(joint: Point, point: Point, angle: float) -> Point:
    """Transform a point from the frame of the child link to that of the parent link."""
    s, c = math.sin(angle), math.cos(angle)
    return joint[0] + c * point[0] + s * point[1], joint[1] - s * point[0] + c * point[1]


def _difference(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1]


def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1]


def _motion_per_angle(pin: Point, point: Point) -> Point:
    """Return the derivative of a point's position by a rotation about a pin [m/rad]."""
    x, z = _difference(point, pin)
    return z, -x


def _side_of_line(a: Point, b: Point, point: Point) -> float:
    """Return the side of a point relative to the line from a to b: +1.0 left, -1.0 right."""
    (ux, uz), (vx, vz) = _difference(b, a), _difference(point, a)
    return math.copysign(1.0, ux * vz - uz * vx)


def _circle_intersection(a: Point, ra: float, b: Point, rb: float, side: float) -> Point | None:
    """Return the intersection of circles about a and b on one side of the line a to b, or None."""
    distance = math.dist(a, b)
    if distance == 0.0:
        return None
    along = (ra * ra - rb * rb + distance * distance) / (2.0 * distance)
    square = ra * ra - along * along
    if square < 0.0:
        # Circles that touch in one point may miss each other by rounding.
        if square < -1e-12:
            return None
        square = 0.0
    across = side * math.sqrt(square)
    ux, uz = (b[0] - a[0]) / distance, (b[1] - a[1]) / distance
    return a[0] + along * ux - across * uz, a[1] + along * uz + across * ux
