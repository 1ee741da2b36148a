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
"""

from __future__ import annotations

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


@dataclass(frozen=True)
class JoystickReading:
    """Velocities in one message of the joystick.

    Attributes:
        joints: velocities in the actuators' order [rad/s].
        tracks: velocities left, right [m/s].
        pedals_at_rest: whether the left and the right pedal are released.
    """

    joints: tuple[float, ...]
    tracks: tuple[float, float]
    pedals_at_rest: tuple[bool, bool]


class JoystickState(NamedTuple):
    """What follows from the messages so far.

    Attributes:
        levers_active, pedals_active: whether they command the machine.
        must_return_to_rest: whether no command counts until all are released.
        pedal_seen_at_rest: whether the left and the right pedal were released once.
    """

    levers_active: bool
    pedals_active: bool
    must_return_to_rest: bool
    pedal_seen_at_rest: tuple[bool, bool]


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
        # joy_node reports 0, which is half pressed, for a trigger that was never touched.
        is_at_rest = params.joy_pedal_rest == 0.0
        self.restore(JoystickState(False, False, False, (is_at_rest, is_at_rest)))

    @property
    def state(self) -> JoystickState:
        """What follows from the messages so far."""
        left, right = self._pedal_seen_at_rest
        return JoystickState(
            self._levers_active, self._pedals_active, self._must_return_to_rest, (left, right)
        )

    def restore(self, state: JoystickState) -> None:
        """Continue after the messages of a state."""
        self._levers_active, self._pedals_active = state.levers_active, state.pedals_active
        self._must_return_to_rest = state.must_return_to_rest
        self._pedal_seen_at_rest = list(state.pedal_seen_at_rest)

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
        joints = []
        for joint in self._joints:
            lever = self._axis_of_joint.get(joint.name)
            if lever is None:
                joints.append(0.0)
                continue
            axis, sign = lever
            joints.append(sign * joint.max_speed * self._beyond_deadzone(values[self._axes[axis]]))
        pedals = [self._pedal(values, pressed, side) for side in ("left", "right")]
        left, right = (
            pedal * track.max_speed for pedal, track in zip(pedals, self._tracks, strict=True)
        )
        # Adding zero turns -0.0 into 0.0.
        return JoystickReading(
            tuple(velocity + 0.0 for velocity in joints),
            (left + 0.0, right + 0.0),
            (left == 0.0, right == 0.0),
        )

    def select_commands(self, reading: JoystickReading, *, stopped: bool) -> dict[int, float]:
        """Return the commanded velocities by actuator index; empty if the message is no command.

        Args:
            reading: velocities of the message.
            stopped: whether the emergency stop is active.
        """
        for side, pedals_at_rest in enumerate(reading.pedals_at_rest):
            self._pedal_seen_at_rest[side] |= pedals_at_rest
        tracks = [
            v if ready else 0.0
            for v, ready in zip(reading.tracks, self._pedal_seen_at_rest, strict=True)
        ]
        levers_deflected, pedals_deflected = any(reading.joints), any(tracks)
        if stopped or self._must_return_to_rest:
            self._must_return_to_rest = levers_deflected or pedals_deflected
            return {}
        commands: dict[int, float] = {}
        if levers_deflected or self._levers_active:
            commands.update(enumerate(reading.joints))
        if pedals_deflected or self._pedals_active:
            commands.update(enumerate(tracks, start=len(reading.joints)))
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

    def _pedal(self, axes: list[float], buttons: list[float], side: str) -> float:
        """Return the deflection of a pedal, -1 (backward) to 1 (forward)."""
        index = self._axes[f"{side}_pedal"]
        if index < 0:
            return 0.0
        params = self._params
        travel = params.joy_pedal_full - params.joy_pedal_rest
        pedal = self._beyond_deadzone((axes[index] - params.joy_pedal_rest) / travel)
        button = params.joy_left_reverse if side == "left" else params.joy_right_reverse
        reverse = 0 <= button < len(buttons) and buttons[button] != 0.0
        return -pedal if reverse else pedal
