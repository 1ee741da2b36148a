"""Deflections of levers and pedals as the axes and buttons of a `sensor_msgs/Joy` message."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from machine_sim.commands import CommandParams

__all__ = ["JoyValues", "to_joy"]

_MAX_AXIS = 1.0


class JoyValues(NamedTuple):
    """Values of a `Joy` message.

    Attributes:
        axes: values of the axes, -1 to 1.
        buttons: 1 for each pressed button, else 0.
    """

    axes: list[float]
    buttons: list[int]


def to_joy(deflections: Mapping[str, float], params: CommandParams) -> JoyValues:
    """Return the message that a machine reads as these deflections.

    Deflections begin beyond the deadzone of the machine. A pedal whose axis has no backward side is
    reversed by its button, as on a gamepad.

    Args:
        deflections: deflection of each of `key_layout.CONTROLS`, -1 to 1.
        params: parameters of the machine node's commands.
    """
    buttons = [0] * (max(params.joy_left_reverse, params.joy_right_reverse, -1) + 1)
    axes = [0.0] * (max(params.joy_axes.values()) + 1)
    for control, index in params.joy_axes.items():
        if index < 0:
            continue
        value = _beyond_deadzone(deflections[control], params.joy_deadzone)
        if not control.endswith("_pedal"):
            axes[index] = value
            continue
        rest, full = params.joy_pedal_rest, params.joy_pedal_full
        axes[index] = rest + (full - rest) * value
        if abs(axes[index]) > _MAX_AXIS:
            axes[index] = rest + (full - rest) * abs(value)
            button = getattr(params, f"joy_{control.removesuffix('_pedal')}_reverse")
            if button < 0:
                axes[index] = rest  # this gamepad cannot drive backward
            else:
                buttons[button] = 1
    return JoyValues(axes, buttons)


def _beyond_deadzone(deflection: float, zone: float) -> float:
    """Return the value of an axis that is read as a deflection."""
    if deflection == 0.0:
        return 0.0
    value = zone + (1.0 - zone) * abs(deflection)
    return value if deflection > 0.0 else -value
