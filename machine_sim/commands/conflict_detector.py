"""Detection of a command conflict: commands of several publishers that alternate.

The newest command of an actuator applies, so that an actuator which two publishers command with
different values follows each of them in turn. A publisher that hands over to another, once or back
and forth by an operator, is no conflict, nor are publishers that command different actuators, or
the same values.
"""

from __future__ import annotations

from collections import defaultdict, deque
from typing import NamedTuple

from machine_sim.commands.parser import Setpoint, Setpoints

__all__ = ["CommandConflict", "ConflictDetector"]

_NUM_CHANGES = 3
"""Number of changes of the publisher that are a conflict."""

_CHANGE_TIME = 2.0
"""Time within which they occur [s]; with the default timeout, commands in force are renewed at
3 Hz or more."""

_HOLD_TIME = 3.0
"""Time for which a conflict lasts after the last change [s]."""


class CommandConflict(NamedTuple):
    """Actuators that follow several publishers in turn.

    Attributes:
        actuators: their indices, joints first.
        topics: topics of the commands, sorted.
    """

    actuators: tuple[int, ...]
    topics: tuple[str, ...]


class _LastCommand(NamedTuple):
    """Newest command of an actuator, and its topic."""

    setpoint: Setpoint
    topic: str


class _Change(NamedTuple):
    """A change from the command of one publisher to that of another."""

    time: float
    topics: frozenset[str]


class ConflictDetector:
    """Detects conflicts among the commands of one machine.

    A message does not state its publisher, but publishers number their messages: of messages on one
    topic, one whose number does not increase is from another publisher than the message before.
    """

    def __init__(self) -> None:
        self._last_numbers: dict[str, int] = {}  # by topic
        self._last_commands: dict[int, _LastCommand] = {}  # by actuator
        self._changes: defaultdict[int, deque[_Change]] = defaultdict(
            lambda: deque(maxlen=_NUM_CHANGES)
        )

    def record(self, topic: str, number: int | None, setpoints: Setpoints, now: float) -> None:
        """Record a command.

        Args:
            topic: its topic.
            number: its number among the messages of its publisher; None with a middleware that does
                not number messages, where publishers of one topic cannot be distinguished.
            setpoints: setpoints by actuator index; empty for a joystick at rest.
            now: time of arrival [s], by any clock.
        """
        is_other_publisher = False
        if number is not None:
            is_other_publisher = number <= self._last_numbers.get(topic, -1)
            self._last_numbers[topic] = number
        for actuator, setpoint in setpoints.items():
            last = self._last_commands.get(actuator)
            self._last_commands[actuator] = _LastCommand(setpoint, topic)
            if last is None or last.setpoint == setpoint:
                continue
            if is_other_publisher or last.topic != topic:
                change = _Change(now, frozenset((topic, last.topic)))
                self._changes[actuator].append(change)

    def find(self, now: float) -> CommandConflict | None:
        """Return the present conflict; None without one.

        Args:
            now: present time [s], by the same clock.
        """
        actuators: set[int] = set()
        topics: set[str] = set()
        for actuator, changes in self._changes.items():
            if len(changes) < _NUM_CHANGES or now - changes[-1].time > _HOLD_TIME:
                continue
            if changes[-1].time - changes[0].time <= _CHANGE_TIME:
                actuators.add(actuator)
                topics.update(*(change.topics for change in changes))
        if not actuators:
            return None
        return CommandConflict(tuple(sorted(actuators)), tuple(sorted(topics)))
