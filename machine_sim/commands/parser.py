"""Validation of commands: each is accepted or rejected as a whole.

A velocity above the actuator's maximum is accepted, and the machine limits it. A value that exceeds
the maximum by `unit_error_factor` is rejected as a mistake of units.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from machine_sim.commands.actuators import Actuator
from machine_sim.commands.errors import CommandError
from machine_sim.commands.params import CommandParams
from machine_sim.commands.position_control import POSITION_TOLERANCE
from machine_sim.commands.validation import format_value, validate_number, validate_numbers

__all__ = ["CommandParser", "Setpoint", "Setpoints"]


@dataclass(frozen=True)
class Setpoint:
    """Target of one actuator.

    Attributes:
        value: velocity [rad/s or m/s], or target angle [rad].
        is_position: whether the value is an angle.
    """

    value: float
    is_position: bool = False


Setpoints = Mapping[int, Setpoint]
"""Setpoints by actuator index: joints first, then the tracks."""


class CommandParser:
    """Stateless parser of the commands of one machine."""

    def __init__(self, actuators: Sequence[Actuator], gauge: float, params: CommandParams) -> None:
        """
        Args:
            actuators: joints, then left and right track.
            gauge: distance between the centre lines of the tracks [m].
            params: parameters of the command inputs.
        """
        self._actuators = tuple(actuators)
        self._index = {actuator.name: i for i, actuator in enumerate(self._actuators)}
        self._joints = range(len(self._actuators) - 2)
        self._tracks = range(len(self._actuators) - 2, len(self._actuators))
        self._gauge = gauge
        self._params = params

    def parse_front(self, values: Any) -> Setpoints:
        """Return setpoints from velocities of all joints in order [rad/s]."""
        order = ", ".join(self._actuators[i].name for i in self._joints)
        return self._parse_velocities(
            self._joints, values, "the front command", f"joint velocities [rad/s]: {order}"
        )

    def parse_tracks(self, values: Any) -> Setpoints:
        """Return setpoints from track velocities left, right [m/s]."""
        return self._parse_velocities(
            self._tracks, values, "the track command", "track velocities [m/s]: left, right"
        )

    def parse_twist(self, linear: Any, angular: Any) -> Setpoints:
        """Return track setpoints from forward [m/s] and yaw velocity [rad/s, + to the left].

        If a track would exceed its maximum speed, both are scaled down by the same factor, which
        keeps the radius of the curve.
        """
        v = validate_number(linear, "the twist's linear.x", "a finite velocity [m/s]")
        w = validate_number(angular, "the twist's angular.z", "a finite velocity [rad/s]")
        half = 0.5 * self._gauge * w
        speeds = (v - half, v + half)
        request = f"linear.x {v:g} m/s with angular.z {w:g} rad/s"
        scale = 1.0
        for i, speed in zip(self._tracks, speeds, strict=True):
            self._check_units(i, speed, request)
            scale = max(scale, abs(speed) / self._actuators[i].max_speed)
        return {i: Setpoint(s / scale) for i, s in zip(self._tracks, speeds, strict=True)}

    def parse_joints(self, names: Any, velocity: Any, position: Any) -> Setpoints:
        """Return setpoints of named actuators from velocities [rad/s, m/s] or angles [rad]."""
        known = ", ".join(self._index)
        named = self._parse_names(names, known)
        velocities = validate_numbers(
            velocity, "velocity of the joint command", "one value for each name"
        )
        positions = validate_numbers(
            position, "position of the joint command", "one value for each name"
        )
        if bool(velocities) == bool(positions):
            which = "both velocity and position" if velocities else "neither velocity nor position"
            raise CommandError(
                f"the joint command gives {which}; give one of them, and leave the other empty"
            )
        values = velocities or positions
        if len(values) != len(named):
            raise CommandError(
                f"the joint command has {len(named)} names and {len(values)} values;"
                " give one value for each name"
            )
        setpoints = {}
        for name, value in zip(named, values, strict=True):
            i = self._index[name]
            if velocities:
                self._check_units(i, value, f"velocity {value:g} of {name}")
                setpoints[i] = Setpoint(value)
            else:
                setpoints[i] = Setpoint(
                    self._position_setpoint(self._actuators[i], value), is_position=True
                )
        return setpoints

    def check_stamp(self, stamp: Any, sim_now: float) -> None:
        """Reject a stamp [s] that is too old or too new, if `check_stamps` is set.

        Args:
            stamp: simulation time of the command [s].
            sim_now: present simulation time [s].

        Raises:
            CommandError: no stamp, an old one, or one from the future.
        """
        if not self._params.check_stamps:
            return
        given = validate_number(stamp, "the stamp", "simulation time, or switch off check_stamps")
        age = sim_now - given
        if age > self._params.command_timeout:
            raise CommandError(
                f"the command's stamp is {age:g} s old, more than command_timeout"
                f" {self._params.command_timeout:g} s; stamp it with simulation time (/clock),"
                " or switch off check_stamps"
            )
        if age < -self._params.max_stamp_lead:
            raise CommandError(
                f"the command's stamp is {-age:g} s in the future; stamp it with simulation time"
                " (/clock: use_sim_time on the sender), or switch off check_stamps"
            )

    def _parse_velocities(self, indices: range, values: Any, what: str, order: str) -> Setpoints:
        """Return velocity setpoints of the actuators with these indices."""
        expected = f"{len(indices)} {order}"
        given = validate_numbers(values, what, expected)
        if len(given) != len(indices):
            raise CommandError(f"{what} has {len(given)} values; give {expected}")
        for i, value in zip(indices, given, strict=True):
            self._check_units(i, value, f"velocity {value:g} of {self._actuators[i].name}")
        return {i: Setpoint(value) for i, value in zip(indices, given, strict=True)}

    def _parse_names(self, names: Any, known: str) -> list[str]:
        """Return the names of a joint command; each is known and unique."""
        # A single string is iterable, too: over its letters.
        is_list = isinstance(names, Iterable) and not isinstance(names, (str, bytes))
        named: list[Any] = list(names) if is_list else [None]
        if not all(isinstance(name, str) for name in named):
            raise CommandError(f"names are {format_value(names)}; give a list out of {known}")
        if not named:
            raise CommandError(f"the joint command names no joint; name some of {known}")
        unknown = sorted(set(named) - set(self._index))
        if unknown:
            raise CommandError(f"there is no joint {format_value(unknown)}; the names are {known}")
        duplicates = [name for name, count in Counter(named).items() if count > 1]
        if duplicates:
            raise CommandError(
                f"the joint command names {', '.join(duplicates)} twice; name it once"
            )
        return named

    def _position_setpoint(self, actuator: Actuator, angle: float) -> float:
        """Return a target angle [rad] within the limits of the actuator."""
        limits = actuator.limits
        if limits is None:
            raise CommandError(
                f"position of {actuator.name}: a track has none; give it a velocity [m/s]"
            )
        if math.isinf(limits.upper):
            max_angle = 2.0 * math.pi * self._params.unit_error_factor
            if abs(angle) > max_angle:
                raise CommandError(
                    f"position {angle:g} of {actuator.name} is more than {max_angle:g} rad;"
                    " give the angle in rad, the joint turns in the shorter direction"
                )
            return angle
        # The measured angle of a joint at its limit may lie this far beyond it; the command to
        # hold it is valid.
        if not limits.lower - POSITION_TOLERANCE <= angle <= limits.upper + POSITION_TOLERANCE:
            raise CommandError(
                f"position {angle:g} of {actuator.name} is beyond its limits; give"
                f" {limits.lower:g} to {limits.upper:g} rad"
            )
        return min(max(angle, limits.lower), limits.upper)

    def _check_units(self, index: int, value: float, what: str) -> None:
        """Reject a velocity that is far above the maximum of the actuator."""
        actuator = self._actuators[index]
        if abs(value) > self._params.unit_error_factor * actuator.max_speed:
            raise CommandError(
                f"{what} is more than {self._params.unit_error_factor:g} times the maximum of"
                f" {actuator.name} ({actuator.max_speed:g} {actuator.unit}); check the units: give"
                f" {actuator.unit}"
            )
