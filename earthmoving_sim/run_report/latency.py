"""Time from a command to its effect.

A command is a message on a command topic that differs from the one before on this topic. Its effect
is the first tick whose applied commands, which are recorded every tick, are the commanded
velocities; for a command of another kind, such as positions or a joystick, the first tick in which
the applied commands change.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

__all__ = ["CommandLatency", "Latency"]

_MAX_LATENCY = 1.0
"""Longest time after which a change counts as the effect of a command [s]."""
_MAX_SAMPLES = 100_000
_MAX_WAITING = 100
_TOLERANCE = 1e-6


class Latency(NamedTuple):
    """A latency.

    Attributes:
        wall: in log time, as the recorder received both messages [s].
        simulated: in simulation time [s]; None if the command has no stamp.
    """

    wall: float
    simulated: float | None


class _Command(NamedTuple):
    """A command that has no effect yet; without a target, any change is its effect."""

    log_time: float
    stamp: float | None
    target: Mapping[str, float]


class CommandLatency:
    """Latencies of the commands of a machine.

    Attributes:
        samples: latency of each command whose effect was found.
        num_commands: number of commands that differ from the one before.
    """

    def __init__(self) -> None:
        self.samples: list[Latency] = []
        self.num_commands = 0
        self._last: dict[str, tuple[float, ...]] = {}
        self._applied: dict[str, float] = {}
        self._waiting: deque[_Command] = deque(maxlen=_MAX_WAITING)

    def add_command(
        self,
        topic: str,
        values: tuple[float, ...],
        log_time: float,
        stamp: float | None,
        target: Mapping[str, float] | None = None,
    ) -> None:
        """Add a command.

        Args:
            topic: its topic.
            values: all of its numbers.
            log_time: log time [s].
            stamp: its simulation time [s], if it has one.
            target: commanded velocities by joint or track, if it has such.
        """
        is_change = topic in self._last and self._last[topic] != values
        self._last[topic] = values
        if is_change:
            self.num_commands += 1
            self._waiting.append(_Command(log_time, stamp, target or {}))

    def add_applied(self, applied: Mapping[str, float], log_time: float, time: float) -> None:
        """Add the applied commands of a tick.

        Args:
            applied: velocities by joint or track.
            log_time: log time [s].
            time: simulation time at the end of the tick [s].
        """
        before, self._applied = self._applied, dict(applied)
        is_changed = bool(before) and any(
            abs(value - before.get(name, value)) > _TOLERANCE for name, value in applied.items()
        )
        while self._waiting and log_time - self._waiting[0].log_time > _MAX_LATENCY:
            self._waiting.popleft()
        for number, command in enumerate(self._waiting):
            is_effect = (
                all(
                    abs(applied.get(name, math.inf) - value) <= _TOLERANCE
                    for name, value in command.target.items()
                )
                if command.target
                else is_changed
            )
            if is_effect:
                self._add(command, log_time, time)
                # Commands before it were replaced before they could have an effect.
                for _ in range(number + 1):
                    self._waiting.popleft()
                break

    def _add(self, command: _Command, log_time: float, time: float) -> None:
        if len(self.samples) < _MAX_SAMPLES and log_time >= command.log_time:
            stamp = command.stamp
            simulated = None if stamp is None or stamp > time else time - stamp
            self.samples.append(Latency(log_time - command.log_time, simulated))
