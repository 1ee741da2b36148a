"""Counters, rejected inputs and problems of a node, published once a second."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from msg_bridge.contract import topics
from msg_bridge.contract.printable import printable
from msg_bridge.contract.topics import resolve

__all__ = ["REJECTION_WARN_TIME", "Diagnostics", "Level", "Report"]

REJECTION_WARN_TIME = 10.0
"""Time for which a rejected input keeps the level at WARN [s]."""

_PERIOD = 1.0  # s between publications, wall clock
_LOG_PERIOD = 1.0  # s between two log lines about one topic

_MAX_REASON_LENGTH = 500
"""Maximum length of a reason: it may quote a message of any size."""


class Level(IntEnum):
    """Condition of a node, as in `diagnostic_msgs/DiagnosticStatus`."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Report:
    """Level, message and values of one publication."""

    level: Level
    message: str
    values: dict[str, str] = field(default_factory=dict)


class _Problem(NamedTuple):
    """A problem of one condition."""

    is_persistent: bool
    level: Level
    text: str


@dataclass
class _RejectionLog:
    """Rejections of one topic."""

    last_at: float
    last_logged: float
    unlogged: int = 0


class Diagnostics:
    """Diagnostics of one node, published also while simulated time stands still."""

    def __init__(
        self,
        node: Node,
        name: str = "",
        hardware_id: str = "",
        *,
        simulation_namespace: str = "/",
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            node: node that publishes.
            name: part of the node, empty for the whole; the status is named
                "<full name of the node>: <name>".
            hardware_id: device concerned, such as the name of the machine.
            simulation_namespace: namespace in which the topic `diagnostics` lies.
            now: wall clock [s].
        """
        self._node = node
        own = str(node.get_fully_qualified_name()).lstrip("/")
        self._name = f"{own}: {name}" if name else own
        self._hardware_id = hardware_id
        self._now = now
        self._values: dict[str, Any] = {}
        self._counts: Counter[str] = Counter()
        self._rejections: dict[str, _RejectionLog] = {}
        self._problems: dict[str, _Problem] = {}  # by condition
        self._tasks: list[Callable[[], None]] = []
        self._publisher = node.create_publisher(
            DiagnosticArray, resolve(topics.DIAGNOSTICS, simulation_namespace), 10
        )
        # A timer of the node's own clock would stop with simulation time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_PERIOD, self.publish, clock=steady)

    def set(self, key: str, value: Any) -> None:
        """Set the value of a key."""
        self._values[key] = value

    def count(self, key: str, n: int = 1) -> None:
        """Add n to the counter `key`."""
        self._counts[key] += n

    def reject(self, topic: str, reason: str) -> None:
        """Count a rejected message and log it, at most once a second for each topic.

        Args:
            topic: name of the topic as the node uses it.
            reason: sentence for the sender.
        """
        now = self._now()
        if len(reason) > _MAX_REASON_LENGTH:
            reason = f"{reason[:_MAX_REASON_LENGTH]} ..."
        reason = printable(reason)
        self.count(f"rejected {topic}")
        self.set(f"last rejected {topic}", reason)
        rejection_log = self._rejections.get(topic)
        if rejection_log is None:
            rejection_log = self._rejections[topic] = _RejectionLog(now, -float("inf"))
        rejection_log.last_at = now
        if now - rejection_log.last_logged < _LOG_PERIOD:
            rejection_log.unlogged += 1
            return
        more = f" ({rejection_log.unlogged} more rejected since)" if rejection_log.unlogged else ""
        self._node.get_logger().warning(f"rejected a message on {topic}: {reason}{more}")
        rejection_log.last_logged, rejection_log.unlogged = now, 0

    def problem(
        self,
        text: str,
        level: Level = Level.WARN,
        *,
        condition: str = "",
        is_persistent: bool = False,
    ) -> None:
        """Set level and message until `clear`.

        Args:
            text: sentence for the user.
            level: condition of the node while the problem lasts.
            condition: name of what is wrong; problems of several conditions are reported together,
                a newer one of the same condition replaces the older one.
            is_persistent: whether it usually lasts, as an overload does; it is reported behind what
                has just happened, since lists cut long texts off.
        """
        self._problems[condition] = _Problem(is_persistent, Level(level), text)

    def clear(self, condition: str = "") -> None:
        """Clear the problem of a condition."""
        self._problems.pop(condition, None)

    def add_task(self, task: Callable[[], None]) -> None:
        """Call `task` before each publication, to set values that are costly to keep current."""
        self._tasks.append(task)

    def report(self) -> Report:
        """Return what would be published now, without calling the tasks."""
        since = self._now() - REJECTION_WARN_TIME
        rejected = [topic for topic, r in self._rejections.items() if r.last_at >= since]
        level, sentences = Level.OK, []
        # The most severe first; of equal ones the oldest.
        order = sorted(self._problems.values(), key=lambda each: (each.is_persistent, -each.level))
        for problem in order:
            level = max(level, problem.level)
            sentences.append(problem.text)
        if rejected:
            level = max(level, Level.WARN)
            sentences.append(f"messages rejected on {', '.join(sorted(rejected))}")
        values = {key: str(value) for key, value in {**self._values, **self._counts}.items()}
        return Report(level, "; ".join(sentences) or "ok", values)

    def publish(self) -> None:
        """Call the tasks and publish."""
        for task in self._tasks:
            task()
        report = self.report()
        status = DiagnosticStatus(
            level=bytes([report.level]),
            name=self._name,
            message=report.message,
            hardware_id=self._hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
