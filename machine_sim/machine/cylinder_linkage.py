"""Cylinders of the arm: from joint angle to cylinder length and back, in closed form.

Everything lies in the arm plane, in the frame of the link that carries the barrel: x forward, z up,
and a joint turns by its angle q about +y, which carries x toward -z. The rod's pin sits on the link
behind the joint, or, where a joint turns too far for that, on a *rocker*: a lever that is pinned to
the same link as the barrel, and whose end a *coupler* joins to the link behind the joint. That is a
four-bar linkage; on an excavator it turns the bucket::

      barrel ====== S            S: end of the rocker, the rod's pin and the coupler's
                   / \\
          rocker  /   \\ coupler
                 o     \\
               pin  O---T        O: the joint;  T: the ear on the link behind it
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
"""Below this a cylinder is at a dead centre: it cannot turn the joint [m]."""
_NUM_CHECKED_ANGLES = 200
"""Angles at which a linkage is looked at before it is used."""


@dataclass(frozen=True)
class Rocker:
    """The lever between a cylinder and a joint that turns far.

    Attributes:
        pin: where it is pinned, in the barrel's link [m].
        length: from there to its end [m].
        coupler: length of the coupler, from there to the ear [m].
        ear: where the coupler is pinned, in the link behind the joint [m].
    """

    pin: Point
    length: float
    coupler_length: float
    coupler_pin: Point


class LinkagePins(NamedTuple):
    """Where the pins are, in the frame of the barrel's link [m]; `ear` only with a rocker."""

    barrel: Point
    rod: Point
    coupler_pin: Point | None


@dataclass(frozen=True)
class CylinderLinkage:
    """The geometry between a cylinder and the joint that it turns.

    Attributes:
        joint: the joint's pin, in the frame of the link that carries the barrel [m].
        barrel: the barrel's pin, in the same frame [m].
        rod: the rod's pin in the frame of the link behind the joint [m]; None with a rocker.
        rocker: the lever in between, or None.
        lower, upper: the joint's limits [rad].
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
            MachineError: both or none of rod and rocker, a linkage that does not close at some
                angle within the limits, or a dead centre there.
        """
        if (self.rod is None) == (self.rocker is None):
            raise MachineError("a cylinder's rod is pinned to the link or to a rocker: give one")
        step = (self.upper - self.lower) / _NUM_CHECKED_ANGLES
        angles = [self.lower + k * step for k in range(_NUM_CHECKED_ANGLES + 1)]
        levers = [self.lever_arm(angle) for angle in angles]
        for angle, lever_arm in zip(angles, levers, strict=True):
            if abs(lever_arm) < _MIN_LEVER_ARM or (lever_arm > 0.0) != (levers[0] > 0.0):
                raise MachineError(
                    f"the cylinder is at a dead centre at {angle:.3f} rad, where it cannot turn the"
                    " joint; move a pin, or narrow the joint's limits"
                )

    @cached_property
    def extension_sign(self) -> float:
        """+1 where the cylinder grows longer with the angle, -1 where it grows shorter."""
        return math.copysign(1.0, self.lever_arm(0.5 * (self.lower + self.upper)))

    @cached_property
    def min_length(self) -> float:
        """Length at the end of the joint's range where the cylinder is in [m]."""
        return min(self.length(self.lower), self.length(self.upper))

    @cached_property
    def max_length(self) -> float:
        """Length at the end of the joint's range where the cylinder is out [m]."""
        return max(self.length(self.lower), self.length(self.upper))

    def pins(self, angle: float) -> LinkagePins:
        """Where the pins are at a joint angle [rad].

        Raises:
            MachineError: the rocker and its coupler do not reach.
        """
        if self.rocker is None:
            assert self.rod is not None
            return LinkagePins(self.barrel, _in_parent_frame(self.joint, self.rod, angle), None)
        coupler_pin = _in_parent_frame(self.joint, self.rocker.coupler_pin, angle)
        # Of the two places the one on the far side from the joint: the four-bar is not crossed.
        end = _circle_intersection(
            self.rocker.pin, self.rocker.length, coupler_pin, self.rocker.coupler_length,
            -_side_of_line(self.rocker.pin, coupler_pin, self.joint),
        )  # fmt: skip
        if end is None:
            raise MachineError(
                f"rocker and coupler do not reach each other at {angle:.3f} rad; lengthen one, or"
                " narrow the joint's limits"
            )
        return LinkagePins(self.barrel, end, coupler_pin)

    def length(self, angle: float) -> float:
        """Of the cylinder from pin to pin [m], at a joint angle [rad]."""
        return math.dist(self.barrel, self.pins(angle).rod)

    def lever_arm(self, angle: float) -> float:
        """Growth of the cylinder per turn of the joint, dL/dq [m/rad], at an angle [rad].

        It is the lever arm, too: what the cylinder pushes with times this is the joint's torque.
        """
        return self.length_and_lever_arm(angle)[1]

    def length_and_lever_arm(self, angle: float) -> tuple[float, float]:
        """`length` and `lever` at once: most of the work is to find the pins."""
        barrel, rod, coupler_pin = self.pins(angle)
        length = math.dist(barrel, rod)
        if coupler_pin is None:
            way = _motion_per_angle(self.joint, rod)
        else:
            # The end goes round the rocker's pin, as fast as keeps the coupler's length.
            assert self.rocker is not None
            round_pin, along = (
                _motion_per_angle(self.rocker.pin, rod),
                _difference(rod, coupler_pin),
            )
            share = _dot(along, round_pin)
            if share == 0.0:
                return length, math.inf
            speed = _dot(along, _motion_per_angle(self.joint, coupler_pin)) / share
            way = (speed * round_pin[0], speed * round_pin[1])
        return length, _dot(_difference(rod, barrel), way) / length

    def angle(self, length: float) -> float:
        """Joint angle [rad] at a cylinder length [m].

        Raises:
            MachineError: a length that the cylinder does not have within the joint's limits.
        """
        low, high = self.min_length, self.max_length
        if not low - 1e-9 <= length <= high + 1e-9:
            raise MachineError(
                f"a cylinder of {length:.4f} m is beyond the joint's limits; give {low:.4f} to"
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
            self.joint, math.hypot(*self.rocker.coupler_pin), end, self.rocker.coupler_length,
            _side_of_line(self.joint, pins.rod, pins.coupler_pin),
        )  # fmt: skip
        assert coupler_pin is not None, "lengths within the limits close the linkage"
        return self._angle_of(self.rocker.coupler_pin, coupler_pin)

    def _rod_pin_at(self, pin: Point, radius: float, length: float) -> Point:
        """Where the rod's pin is, which goes round `pin`, on the side where it is all the time."""
        rod = self.pins(0.5 * (self.lower + self.upper)).rod
        end = _circle_intersection(
            self.barrel, length, pin, radius, _side_of_line(self.barrel, pin, rod)
        )
        assert end is not None, "lengths within the limits close the linkage"
        return end

    def _angle_of(self, at_zero: Point, at: Point) -> float:
        """Turn that carries a point of the link behind the joint to where it is."""
        x, z = _difference(at, self.joint)
        turn = math.atan2(at_zero[1], at_zero[0]) - math.atan2(z, x)
        middle = 0.5 * (self.lower + self.upper)
        return middle + math.remainder(turn - middle, 2.0 * math.pi)


def _in_parent_frame(joint: Point, point: Point, angle: float) -> Point:
    """A point of the link behind the joint, in the frame of the link before it."""
    s, c = math.sin(angle), math.cos(angle)
    return joint[0] + c * point[0] + s * point[1], joint[1] - s * point[0] + c * point[1]


def _difference(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1]


def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1]


def _motion_per_angle(pin: Point, point: Point) -> Point:
    """Way of a point per turn about a pin [m/rad]."""
    x, z = _difference(point, pin)
    return z, -x


def _side_of_line(a: Point, b: Point, point: Point) -> float:
    """On which side of the line from a to b a point lies: +1 or -1."""
    (ux, uz), (vx, vz) = _difference(b, a), _difference(point, a)
    return math.copysign(1.0, ux * vz - uz * vx)


def _circle_intersection(a: Point, ra: float, b: Point, rb: float, side: float) -> Point | None:
    """Where circles about a and b meet, on one side of the line from a to b; None if nowhere."""
    distance = math.dist(a, b)
    if distance == 0.0:
        return None
    along = (ra * ra - rb * rb + distance * distance) / (2.0 * distance)
    square = ra * ra - along * along
    if square < 0.0:
        # At full stretch rounding may miss by a little.
        if square < -1e-12:
            return None
        square = 0.0
    across = side * math.sqrt(square)
    ux, uz = (b[0] - a[0]) / distance, (b[1] - a[1]) / distance
    return a[0] + along * ux - across * uz, a[1] + along * uz + across * ux
