"""Joystick: levers and pedals of a cab from the axes and buttons of a gamepad.

The lever patterns of an excavator:

    ISO   left lever: swing, arm      right lever: bucket, boom
    SAE   left lever: swing, boom     right lever: bucket, arm

A deflection to the left swings left or curls the bucket in; forward lowers the boom or extends the
arm. ROS axes are positive to the left and forward; joint angles follow the right-hand rule about
+y, so positive lowers. The file of any other machine assigns axes to its joints; a joint without
an axis has no lever.

A gamepad publishes continuously, so its values at rest are no commands. The levers as a group, and
the pedals as a group, are active from the first deflection until all are released; the release is
one last command of zero, after which other sources may command the machine. After an emergency stop
no command counts until all levers and pedals were released: a lever held through the stop does not
start the machine.

An axis that is deflected in the first message of a device is held by someone, or is another axis
than the parameters name, such as a trigger that reports 1 when it is released. It counts once it
has been at rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from machine_sim.commands.actuators import Actuator
from machine_sim.commands.errors import CommandError
from machine_sim.commands.params import CommandParams
from machine_sim.commands.validation import validate_numbers

__all__ = ["LEVER_PATTERNS", "Joystick", "JoystickReading", "JoystickState"]

LEVER_PATTERNS = {
    "iso": {
        "swing": ("left_x", 1.0),
        "arm": ("left_y", -1.0),
        "bucket": ("right_x", 1.0),
        "boom": ("right_y", 1.0),
    },
    "sae": {
        "swing": ("left_x", 1.0),
        "boom": ("left_y", 1.0),
        "bucket": ("right_x", 1.0),
        "arm": ("right_y", -1.0),
    },
}
"""Axis and sign of each joint, by pattern."""

_SIDES = ("left", "right")

_MAX_FIRST_DEFLECTION = 0.25
"""Maximum deflection in the first message of an axis that counts at once: a source that is silent
at rest, such as the live page, begins with a lever that has just begun to move. A trigger that
reports 0 until it is touched, and 1 when it is released, is half pressed."""

_LOST_TIME = 1.0
"""Time without a message after which a device counts as lost [s], and its next message as the
first one."""


@dataclass(frozen=True)
class JoystickReading:
    """Velocities in one message of the joystick.

    Attributes:
        joints: velocities in the actuators' order [rad/s].
        tracks: velocities left, right [m/s].
        deflections: deflection of each axis in use beyond the deadzone, -1 to 1, by its name.
    """

    joints: tuple[float, ...]
    tracks: tuple[float, float]
    deflections: Mapping[str, float]


class JoystickState(NamedTuple):
    """What follows from the messages so far.

    Attributes:
        levers_active, pedals_active: whether they command the machine.
        must_return_to_rest: whether no command counts until all are released.
        ready_axes: names of the axes that count, because they have been at rest.
        last_arrival: time of the last message [s], by the clock of the commands.
    """

    levers_active: bool
    pedals_active: bool
    must_return_to_rest: bool
    ready_axes: frozenset[str]
    last_arrival: float


class Joystick:
    """Reads joystick messages and selects those that are commands."""

    def __init__(
        self,
        actuators: Sequence[Actuator],
        params: CommandParams,
        levers: Mapping[str, tuple[str, float]],
    ) -> None:
        """
        Args:
            actuators: joints in any order, then left and right track.
            params: lever pattern, axes and buttons.
            levers: axis and sign of each joint; empty: those of the pattern.
        """
        self._joints = tuple(actuators[:-2])
        self._tracks = tuple(actuators[-2:])
        self._params = params
        self._axes = params.joy_axes
        self._axis_of_joint = dict(levers) or LEVER_PATTERNS[params.joy_pattern]
        used = {self._axis_of_joint.get(joint.name, ("",))[0] for joint in self._joints}
        self._axes_in_use = [
            name
            for name, index in self._axes.items()
            if index >= 0 and (name in used or name.endswith("_pedal"))
        ]
        self.restore(JoystickState(False, False, False, frozenset(), -math.inf))

    @property
    def state(self) -> JoystickState:
        """What follows from the messages so far."""
        return JoystickState(
            self._levers_active,
            self._pedals_active,
            self._must_return_to_rest,
            self._ready_axes,
            self._last_arrival,
        )

    def restore(self, state: JoystickState) -> None:
        """Continue after the messages of a state."""
        self._levers_active, self._pedals_active = state.levers_active, state.pedals_active
        self._must_return_to_rest = state.must_return_to_rest
        self._ready_axes, self._last_arrival = state.ready_axes, state.last_arrival

    def ignored_axes(self, now: float) -> list[str]:
        """Return the axes that have not been at rest; none if the device is silent.

        Args:
            now: present time, by the clock of the commands [s].

        Returns:
            Index and parameter of each axis.
        """
        if self._last_arrival == -math.inf or now - self._last_arrival > _LOST_TIME:
            return []
        return [
            f"axis {self._axes[name]} (joy_{name})"
            for name in self._axes_in_use
            if name not in self._ready_axes
        ]

    def read(self, axes: Any, buttons: Any) -> JoystickReading:
        """Return the velocities of a message without changing any state.

        A button that is missing in the message counts as not pressed.

        Raises:
            CommandError: too few axes, a number that is not finite, or an axis far beyond 1.
        """
        num_axes = max(self._axes.values()) + 1
        values = validate_numbers(
            axes, "the joystick's axes", f"at least {num_axes} axes from -1 to 1"
        )
        pressed = validate_numbers(buttons, "the joystick's buttons", "0 or 1 for each")
        if len(values) < num_axes:
            raise CommandError(
                f"the joystick has {len(values)} axes and needs {num_axes}; use a game controller,"
                " or set the joy_ parameters to its axes"
            )
        for name, index in self._axes.items():
            if index >= 0 and abs(values[index]) > self._params.unit_error_factor:
                raise CommandError(
                    f"axis {index} (joy_{name}) of the joystick is {values[index]:g}; give values"
                    " from -1 to 1, 1 to the left and forward"
                )
        deflections = {name: self._deflection(name, values) for name in self._axes_in_use}
        joints = []
        for joint in self._joints:
            axis, sign = self._axis_of_joint.get(joint.name, ("", 0.0))
            joints.append(sign * joint.max_speed * deflections.get(axis, 0.0))
        pedals = [
            self._direction(side, pressed) * deflections.get(f"{side}_pedal", 0.0)
            for side in _SIDES
        ]
        left, right = (
            pedal * track.max_speed for pedal, track in zip(pedals, self._tracks, strict=True)
        )
        # Adding zero turns -0.0 into 0.0.
        return JoystickReading(
            tuple(velocity + 0.0 for velocity in joints), (left + 0.0, right + 0.0), deflections
        )

    def select_commands(
        self, reading: JoystickReading, arrival: float, *, stopped: bool
    ) -> dict[int, float]:
        """Return the commanded velocities by actuator index; empty if the message is no command.

        Args:
            reading: velocities of the message.
            arrival: time of its arrival, by the clock of the commands [s].
            stopped: whether the emergency stop is active.
        """
        self._update_ready_axes(reading.deflections, arrival)
        joints = [
            velocity if self._axis_of_joint.get(joint.name, ("",))[0] in self._ready_axes else 0.0
            for joint, velocity in zip(self._joints, reading.joints, strict=True)
        ]
        tracks = [
            velocity if f"{side}_pedal" in self._ready_axes else 0.0
            for side, velocity in zip(_SIDES, reading.tracks, strict=True)
        ]
        levers_deflected, pedals_deflected = any(joints), any(tracks)
        if stopped or self._must_return_to_rest:
            self._must_return_to_rest = levers_deflected or pedals_deflected
            return {}
        commands: dict[int, float] = {}
        if levers_deflected or self._levers_active:
            commands.update(enumerate(joints))
        if pedals_deflected or self._pedals_active:
            commands.update(enumerate(tracks, start=len(joints)))
        self._levers_active, self._pedals_active = levers_deflected, pedals_deflected
        return commands

    def stop(self) -> None:
        """Ignore all commands until levers and pedals were released: an emergency stop."""
        self._must_return_to_rest = True
        self.reset()

    def reset(self) -> None:
        """Mark levers and pedals as released."""
        self._levers_active = self._pedals_active = False

    def _beyond_deadzone(self, deflection: float) -> float:
        """Return the deflection beyond the deadzone, -1 to 1, zero at its edge."""
        zone = self._params.joy_deadzone
        beyond = min(max(abs(deflection) - zone, 0.0) / (1.0 - zone), 1.0)
        return beyond if deflection > 0.0 else -beyond

    def _deflection(self, name: str, values: list[float]) -> float:
        """Return the deflection of an axis beyond the deadzone; of a pedal, along its travel."""
        value = values[self._axes[name]]
        if name.endswith("_pedal"):
            rest, full = self._params.joy_pedal_rest, self._params.joy_pedal_full
            value = (value - rest) / (full - rest)
        return self._beyond_deadzone(value)

    def _direction(self, side: str, buttons: list[float]) -> float:
        """Return -1 while the button is pressed that reverses a pedal, else 1."""
        button = getattr(self._params, f"joy_{side}_reverse")
        return -1.0 if 0 <= button < len(buttons) and buttons[button] != 0.0 else 1.0

    def _update_ready_axes(self, deflections: Mapping[str, float], arrival: float) -> None:
        """Find the axes that are at rest, or were at the beginning."""
        max_deflection = 0.0
        if arrival - self._last_arrival > _LOST_TIME:
            self.reset()
            self._ready_axes, max_deflection = frozenset(), _MAX_FIRST_DEFLECTION
        self._last_arrival = arrival
        at_rest = {name for name, value in deflections.items() if abs(value) <= max_deflection}
        if not at_rest <= self._ready_axes:
            self._ready_axes |= at_rest
