"""Layout of the keys: which key deflects which lever or pedal, and what the other keys do."""

from __future__ import annotations

from typing import Final

__all__ = ["ACTION_KEYS", "CONTROLS", "KEYS", "Deflections"]

Deflections = dict[str, float]
"""Deflection of each control, -1 to 1: levers positive to the left and forward, pedals forward."""

CONTROLS: Final = ("left_x", "left_y", "right_x", "right_y", "left_pedal", "right_pedal")
"""Axes of the two levers and the pedals of the two tracks, as in the parameters `joy_...`."""

KEYS: Final[dict[str, Deflections]] = {
    "w": {"left_y": 1.0},
    "s": {"left_y": -1.0},
    "a": {"left_x": 1.0},
    "d": {"left_x": -1.0},
    "i": {"right_y": 1.0},
    "k": {"right_y": -1.0},
    "j": {"right_x": 1.0},
    "l": {"right_x": -1.0},
    "t": {"left_pedal": 1.0},
    "g": {"left_pedal": -1.0},
    "y": {"right_pedal": 1.0},
    "h": {"right_pedal": -1.0},
    "up": {"left_pedal": 1.0, "right_pedal": 1.0},
    "down": {"left_pedal": -1.0, "right_pedal": -1.0},
    "left": {"left_pedal": -1.0, "right_pedal": 1.0},
    "right": {"left_pedal": 1.0, "right_pedal": -1.0},
}
"""Deflection by key: the left hand has the left lever, the right hand the right one. The arrows
drive both tracks, as in the simulation of 2014."""

ACTION_KEYS: Final = {
    " ": "emergency stop",
    "x": "release the emergency stop",
    "+": "faster",
    "-": "slower",
    "q": "quit",
}
"""Meaning of the other keys."""
