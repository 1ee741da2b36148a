"""Commands as they come in, each checked whole before any of it counts.

What is faster than the machine can passes, for the machine does what it can. What is so far beyond
it that the sender must have meant other units is refused.
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
    """What one actuator shall do.

    Attributes:
        value: velocity [rad/s or m/s], or the angle to go to [rad].
        is_position: whether it is an angle.
    """

    value: float
    is_position: bool = False


Setpoints = Mapping[int, Setpoint]
"""Orders by the actuator's index: joints first, then the tracks."""


class CommandParser:
    """Reads commands for one machine; keeps nothing of them."""

    def __init__(self, actuators: Sequence[Actuator], gauge: float, params: CommandParams) -> None:
        """
        Args:
            actuators: joints, then left and right track.
            gauge: between the tracks' middles [m].
            params: how commands are taken.
        """
        self._actuators = tuple(actuators)
        self._index = {actuator.name: i for i, actuator in enumerate(self._actuators)}
        self._joints = range(len(self._actuators) - 2)
        self._tracks = range(len(self._actuators) - 2, len(self._actuators))
        self._gauge = gauge
        self._params = params

    def front(self, values: Any) -> Setpoints:
        """Velocities of all joints in order [rad/s]."""
        order = ", ".join(self._actuators[i].name for i in self._joints)
        return self._parse_velocities(
            self._joints, values, "the front command", f"joint velocities [rad/s]: {order}"
        )

    def tracks(self, values: Any) -> Setpoints:
        """Velocities left, right [m/s]."""
        return self._parse_velocities(
            self._tracks, values, "the track command", "track velocities [m/s]: left, right"
        )

    def twist(self, linear: Any, angular: Any) -> Setpoints:
        """Forward [m/s] and turning velocity [rad/s, + to the left], split onto the tracks.

        Where a track would have to be faster than it can, both are slowed down alike, so that
        the machine stays on the curve it was told.
        """
        v = validate_number(linear, "the twist's linear.x", "a finite velocity [m/s]")
        w = validate_number(angular, "the twist's angular.z", "a finite velocity [rad/s]")
        half = 0.5 * self._gauge * w
        speeds = (v - half, v + half)
        wanted = f"linear.x {v:g} m/s with angular.z {w:g} rad/s"
        slower = 1.0
        for i, speed in zip(self._tracks, speeds, strict=True):
            self._check_units(i, speed, wanted)
            slower = max(slower, abs(speed) / self._actuators[i].max_speed)
        return {i: Setpoint(s / slower) for i, s in zip(self._tracks, speeds, strict=True)}

    def joints(self, names: Any, velocity: Any, position: Any) -> Setpoints:
        """Velocities [rad/s, of tracks m/s] or angles [rad] of the actuators named."""
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
        orders = {}
        for name, value in zip(named, values, strict=True):
            i = self._index[name]
            if velocities:
                self._check_units(i, value, f"velocity {value:g} of {name}")
                orders[i] = Setpoint(value)
            else:
                orders[i] = Setpoint(
                    self._position_setpoint(self._actuators[i], value), is_position=True
                )
        return orders

    def check_stamp(self, stamp: Any, sim_now: float) -> None:
        """Refuse a stamp [s] that is not of now, if stamps are checked; both simulation time.

        Raises:
            CommandError: no stamp, or one too old or from the future.
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
        instead = f"{len(indices)} {order}"
        given = validate_numbers(values, what, instead)
        if len(given) != len(indices):
            raise CommandError(f"{what} has {len(given)} values; give {instead}")
        for i, value in zip(indices, given, strict=True):
            self._check_units(i, value, f"velocity {value:g} of {self._actuators[i].name}")
        return {i: Setpoint(value) for i, value in zip(indices, given, strict=True)}

    def _parse_names(self, names: Any, known: str) -> list[str]:
        # A single text is a sequence too: of letters.
        listed = isinstance(names, Iterable) and not isinstance(names, (str, bytes))
        named: list[Any] = list(names) if listed else [None]
        if not all(isinstance(name, str) for name in named):
            raise CommandError(f"names are {format_value(names)}; give a list out of {known}")
        if not named:
            raise CommandError(f"the joint command names no joint; name some of {known}")
        unknown = sorted(set(named) - set(self._index))
        if unknown:
            raise CommandError(f"there is no joint {format_value(unknown)}; the names are {known}")
        twice = [name for name, count in Counter(named).items() if count > 1]
        if twice:
            raise CommandError(f"the joint command names {', '.join(twice)} twice; name it once")
        return named

    def _position_setpoint(self, actuator: Actuator, angle: float) -> float:
        limits = actuator.limits
        if limits is None:
            raise CommandError(
                f"position of {actuator.name}: a track has none; give it a velocity [m/s]"
            )
        if math.isinf(limits.upper):
            most = 2.0 * math.pi * self._params.unit_error_factor
            if abs(angle) > most:
                raise CommandError(
                    f"position {angle:g} of {actuator.name} is more than {most:g} rad, many turns;"
                    " give the angle in rad, it goes the shorter way around"
                )
            return angle
        # A joint that rests at its limit may be measured this far beyond it: there is no harm in
        # being told to stay.
        if not limits.lower - POSITION_TOLERANCE <= angle <= limits.upper + POSITION_TOLERANCE:
            raise CommandError(
                f"position {angle:g} of {actuator.name} is beyond its limits; give"
                f" {limits.lower:g} to {limits.upper:g} rad"
            )
        return min(max(angle, limits.lower), limits.upper)

    def _check_units(self, index: int, value: float, what: str) -> None:
        actuator = self._actuators[index]
        if abs(value) > self._params.unit_error_factor * actuator.max_speed:
            raise CommandError(
                f"{what}: more than {self._params.unit_error_factor:g} times what {actuator.name} can do"
                f" ({actuator.max_speed:g} {actuator.unit}), which looks like other units; give"
                f" {actuator.unit}"
            )
