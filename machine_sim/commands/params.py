"""Parameters of the command inputs."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["CommandParams"]

_AXES = ("left_x", "left_y", "right_x", "right_y", "left_pedal", "right_pedal")


@dataclass(frozen=True)
class CommandParams(Parameters):
    """Parameters of the command inputs; joystick defaults as in ROS's `game_controller_node`."""

    command_timeout: float = parameter(
        0.3,
        "time after which a command that is not renewed becomes zero",
        unit="s",
        low=0.01,
        high=60.0,
    )
    check_stamps: bool = parameter(
        False, "reject stamped commands that are older than the timeout, or from the future"
    )
    max_stamp_lead: float = parameter(
        0.05,
        "maximum lead of a stamp over the machine's simulation time",
        unit="s",
        low=0.0,
        high=10.0,
    )
    unit_error_factor: float = parameter(
        10.0,
        "a value above the actuator's maximum times this factor is rejected as a mistake of units",
        low=1.0,
        high=1e6,
    )
    joy_pattern: str = parameter(
        "iso", "assignment of the levers to boom and arm", choices=("iso", "sae")
    )
    joy_deadzone: float = parameter(
        0.1, "deflection up to which a lever or pedal counts as released", low=0.0, high=0.9
    )
    joy_left_x: int = parameter(0, "axis of the left lever, + to the left", low=0, high=63)
    joy_left_y: int = parameter(1, "axis of the left lever, + forward", low=0, high=63)
    joy_right_x: int = parameter(2, "axis of the right lever, + to the left", low=0, high=63)
    joy_right_y: int = parameter(3, "axis of the right lever, + forward", low=0, high=63)
    joy_left_pedal: int = parameter(4, "axis of the left track, -1 for none", low=-1, high=63)
    joy_right_pedal: int = parameter(5, "axis of the right track, -1 for none", low=-1, high=63)
    joy_pedal_rest: float = parameter(
        0.0, "value of a pedal's axis when released (triggers of joy_node: 1)", low=-1.0, high=1.0
    )
    joy_pedal_full: float = parameter(
        -1.0,
        "value of a pedal's axis when fully pressed, which is forward; the other side of its"
        " value when released is backward",
        low=-1.0,
        high=1.0,
    )
    joy_left_reverse: int = parameter(
        9, "button that reverses the left pedal while pressed, -1 for none", low=-1, high=63
    )
    joy_right_reverse: int = parameter(
        10, "button that reverses the right pedal while pressed, -1 for none", low=-1, high=63
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        used = Counter(index for index in self.joy_axes.values() if index >= 0)
        duplicates = [name for name, index in self.joy_axes.items() if used[index] > 1]
        if duplicates:
            names = ", ".join(f"joy_{name}" for name in duplicates)
            raise ParameterError(f"CommandParams: {names} share an axis; give each its own axis")
        if abs(self.joy_pedal_full - self.joy_pedal_rest) < 0.1:
            raise ParameterError(
                f"CommandParams.joy_pedal_full is {self.joy_pedal_full} and joy_pedal_rest"
                f" {self.joy_pedal_rest}; give two values of the axis at least 0.1 apart"
            )

    @property
    def joy_axes(self) -> dict[str, int]:
        """Axis index of left_x, left_y, right_x, right_y, left_pedal and right_pedal."""
        return {name: getattr(self, f"joy_{name}") for name in _AXES}
