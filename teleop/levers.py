"""Deflections of levers and pedals from the keys that are held."""

from __future__ import annotations

from collections.abc import Iterable

from teleop.key_layout import CONTROLS, KEYS, Deflections

__all__ = ["Levers"]

_DEFLECTION_RATE = 5.0
"""Rate at which a lever moves toward full deflection [1/s], so that a short press is a small
motion."""

_SPEED_STEP = 0.1
_MIN_SPEED = 0.1


class Levers:
    """Two levers and two pedals that keys deflect and springs return.

    A deflection grows while its key is held, and is zero as soon as it is released.

    Attributes:
        speed: full deflection of a held key, 0.1 to 1.
        deflections: present deflection of each control.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self.deflections: Deflections = dict.fromkeys(CONTROLS, 0.0)

    def change_speed(self, steps: int) -> None:
        """Change the full deflection by a number of steps of 0.1."""
        speed = round(self.speed + _SPEED_STEP * steps, 3)
        self.speed = min(max(speed, _MIN_SPEED), 1.0)

    def update(self, held: Iterable[str], interval: float) -> None:
        """Move the levers.

        Args:
            held: keys that are held; those of opposite directions cancel each other.
            interval: time since the last call [s].
        """
        goals = dict.fromkeys(CONTROLS, 0.0)
        for key in held:
            for control, sign in KEYS.get(key, {}).items():
                goals[control] += sign
        for control, goal in goals.items():
            self.deflections[control] = self._moved(self.deflections[control], goal, interval)

    def release(self) -> None:
        """Return all levers and pedals to their middle."""
        self.update((), 0.0)

    def _moved(self, deflection: float, goal: float, interval: float) -> float:
        if goal == 0.0:
            return 0.0
        sign = 1.0 if goal > 0.0 else -1.0
        reached = max(sign * deflection, 0.0) + _DEFLECTION_RATE * interval
        return sign * min(reached, self.speed)
