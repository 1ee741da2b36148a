"""Levers and pedals of a machine's cab, from the axes and buttons of a gamepad.

Of an excavator, by the pattern that its operators are used to:

    ISO   left lever: swing, arm      right lever: bucket, boom
    SAE   left lever: swing, boom     right lever: bucket, arm

Left swings left or curls the bucket in, forward moves the boom down or the arm out. ROS counts
axes positive to the left and forward; joint angles count downward and inward. The file of any other
machine says which axis moves which of its joints; one that it does not name has no lever.

A gamepad sends all the time, touched or not, so what it sends at rest is no command. The levers
together and the pedals together each count as moved from when one leaves its rest until all are
back; that they are back is one last command of zero, and then they leave the machine to others.
After an emergency stop nothing counts until everything was seen at rest, so that a lever held
through the stop does not set the machine going.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from machine_sim.commands.actuators import Actuator
from machine_sim.commands.errors import CommandError
from machine_sim.commands.params import CommandParams
from machine_sim.commands.validation import validate_numbers

__all__ = ["Joystick", "JoystickReading"]

_LEVER_PATTERNS = {
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
"""Axis and sign of each joint."""


@dataclass(frozen=True)
class JoystickReading:
    """What one message of the joystick says.

    Attributes:
        joints: velocities in the actuators' order [rad/s].
        tracks: velocities left, right [m/s].
        rested: whether each pedal is at rest.
    """

    joints: tuple[float, ...]
    tracks: tuple[float, float]
    pedals_at_rest: tuple[bool, bool]


class Joystick:
    """Reads joystick messages and knows which of them are commands."""

    def __init__(
        self,
        actuators: Sequence[Actuator],
        params: CommandParams,
        levers: Mapping[str, tuple[str, float]],
    ) -> None:
        """
        Args:
            actuators: joints in any order, then left and right track.
            params: pattern, axes and buttons.
            levers: axis and sign of each joint; those of the pattern if there are none.
        """
        self._joints = tuple(actuators[:-2])
        self._tracks = tuple(actuators[-2:])
        self._params = params
        self._axes = params.joy_axes
        self._axis_of_joint = dict(levers) or _LEVER_PATTERNS[params.joy_pattern]
        self._levers_moved = self._pedals_moved = False
        self._must_return_to_rest = (
            False  # through an emergency stop, and not yet seen at rest since
        )
        # joy_node shows 0, which is half pressed, for a trigger that was never touched.
        self._pedal_seen_at_rest = [params.joy_pedal_rest == 0.0] * 2

    def read(self, axes: Any, buttons: Any) -> JoystickReading:
        """What a message says; changes nothing.

        A button that is not in the message is not pressed.

        Raises:
            CommandError: too few axes, a number that is not finite, or an axis far beyond 1.
        """
        need = max(self._axes.values()) + 1
        given = validate_numbers(axes, "the joystick's axes", f"at least {need} axes from -1 to 1")
        pressed = validate_numbers(buttons, "the joystick's buttons", "0 or 1 for each")
        if len(given) < need:
            raise CommandError(
                f"the joystick has {len(given)} axes and needs {need}; use a game controller, or"
                " set the joy_ parameters to the axes of yours"
            )
        for name, index in self._axes.items():
            if index >= 0 and abs(given[index]) > self._params.unit_error_factor:
                raise CommandError(
                    f"axis {index} (joy_{name}) of the joystick is {given[index]:g}; give values"
                    " from -1 to 1, 1 to the left and forward"
                )
        joints = []
        for joint in self._joints:
            lever = self._axis_of_joint.get(joint.name)
            if lever is None:
                joints.append(0.0)
                continue
            axis, sign = lever
            joints.append(sign * joint.max_speed * self._beyond_deadzone(given[self._axes[axis]]))
        pedals = [self._pedal(given, pressed, side) for side in ("left", "right")]
        left, right = (
            pedal * track.max_speed for pedal, track in zip(pedals, self._tracks, strict=True)
        )
        # Adding zero turns -0.0 into 0.0.
        return JoystickReading(
            tuple(velocity + 0.0 for velocity in joints),
            (left + 0.0, right + 0.0),
            (left == 0.0, right == 0.0),
        )

    def select_commands(self, levers: JoystickReading, *, stopped: bool) -> dict[int, float]:
        """What a message commands: velocities by actuator index, none if it is no command.

        Args:
            levers: what it says.
            stopped: whether the emergency stop is pressed.
        """
        for side, pedals_at_rest in enumerate(levers.pedals_at_rest):
            self._pedal_seen_at_rest[side] |= pedals_at_rest
        tracks = [
            v if ready else 0.0
            for v, ready in zip(levers.tracks, self._pedal_seen_at_rest, strict=True)
        ]
        levers_off, pedals_off = any(levers.joints), any(tracks)
        if stopped or self._must_return_to_rest:
            self._must_return_to_rest = levers_off or pedals_off
            return {}
        commands: dict[int, float] = {}
        if levers_off or self._levers_moved:
            commands.update(enumerate(levers.joints))
        if pedals_off or self._pedals_moved:
            commands.update(enumerate(tracks, start=len(levers.joints)))
        self._levers_moved, self._pedals_moved = levers_off, pedals_off
        return commands

    def stop(self) -> None:
        """The emergency stop was pressed: nothing counts until all is seen at rest."""
        self._must_return_to_rest = True
        self.reset()

    def reset(self) -> None:
        """What was moved until now is no command any more."""
        self._levers_moved = self._pedals_moved = False

    def _beyond_deadzone(self, deflection: float) -> float:
        """Deflection beyond the deadzone, -1 to 1, from zero at its edge."""
        zone = self._params.joy_deadzone
        beyond = min(max(abs(deflection) - zone, 0.0) / (1.0 - zone), 1.0)
        return beyond if deflection > 0.0 else -beyond

    def _pedal(self, axes: list[float], buttons: list[float], side: str) -> float:
        index = self._axes[f"{side}_pedal"]
        if index < 0:
            return 0.0
        params = self._params
        way = params.joy_pedal_full - params.joy_pedal_rest
        pedal = self._beyond_deadzone((axes[index] - params.joy_pedal_rest) / way)
        button = params.joy_left_reverse if side == "left" else params.joy_right_reverse
        reverse = 0 <= button < len(buttons) and buttons[button] != 0.0
        return -pedal if reverse else pedal
