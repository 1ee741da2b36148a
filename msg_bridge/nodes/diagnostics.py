"""A node's counters, refused inputs and complaints, once a second on /diagnostics."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from msg_bridge.contract import topics
from msg_bridge.contract.topics import resolve

__all__ = ["REJECTION_WARN_TIME", "Diagnostics", "Level", "Report"]

REJECTION_WARN_TIME = 10.0
"""How long a refused input keeps the level at WARN [s]."""

_PERIOD = 1.0  # s between publications, wall time
_LOG_PERIOD = 1.0  # s between two log lines about one topic

_MAX_REASON_LENGTH = 500
"""Characters shown of a reason: it may quote a message of any size, and is published again."""


class Level(IntEnum):
    """How a node is, as in `diagnostic_msgs/DiagnosticStatus`."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Report:
    """What is published: level, one sentence, and every key with its value as text."""

    level: Level
    message: str
    values: dict[str, str] = field(default_factory=dict)


@dataclass
class _RejectionLog:
    """Of one topic."""

    last_at: float
    last_logged: float
    unlogged: int = 0


class Diagnostics:
    """What one node has to say about itself.

    It is published even while simulation time stands still, since that is when one looks.
    """

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
            name: what of the node this is about, empty for all of it; the status is named
                "<node's full name>: <name>".
            hardware_id: of the device concerned, e.g. the machine's name.
            simulation_namespace: namespace in which the topic `diagnostics` lies.
            now: the wall clock [s].
        """
        self._node = node
        own = str(node.get_fully_qualified_name()).lstrip("/")
        self._name = f"{own}: {name}" if name else own
        self._hardware_id = hardware_id
        self._now = now
        self._values: dict[str, Any] = {}
        self._counts: Counter[str] = Counter()
        self._rejections: dict[str, _RejectionLog] = {}
        self._problem: tuple[Level, str] | None = None
        self._tasks: list[Callable[[], None]] = []
        self._publisher = node.create_publisher(
            DiagnosticArray, resolve(topics.DIAGNOSTICS, simulation_namespace), 10
        )
        # A timer of the node's own clock would stop with simulation time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_PERIOD, self.publish, clock=steady)

    def set(self, key: str, value: Any) -> None:
        """Show `value` under `key`, in place of what was there."""
        self._values[key] = value

    def count(self, key: str, n: int = 1) -> None:
        """Add n to the counter `key`."""
        self._counts[key] += n

    def reject(self, topic: str, reason: str) -> None:
        """Say that a message was refused: counted, logged at most once a second for a topic.

        Args:
            topic: where it came from, as the node calls it.
            reason: a sentence for its sender.
        """
        now = self._now()
        if len(reason) > _MAX_REASON_LENGTH:
            reason = f"{reason[:_MAX_REASON_LENGTH]} ..."
        self.count(f"refused {topic}")
        self.set(f"last refused {topic}", reason)
        rejection_log = self._rejections.get(topic)
        if rejection_log is None:
            rejection_log = self._rejections[topic] = _RejectionLog(now, -float("inf"))
        rejection_log.last_at = now
        if now - rejection_log.last_logged < _LOG_PERIOD:
            rejection_log.unlogged += 1
            return
        more = f" ({rejection_log.unlogged} more refused since)" if rejection_log.unlogged else ""
        self._node.get_logger().warning(f"refused a message on {topic}: {reason}{more}")
        rejection_log.last_logged, rejection_log.unlogged = now, 0

    def problem(self, text: str, level: Level = Level.WARN) -> None:
        """Raise the level until `clear`, with a sentence on what is wrong."""
        self._problem = (Level(level), text)

    def clear(self) -> None:
        """Take the last problem back."""
        self._problem = None

    def add_task(self, task: Callable[[], None]) -> None:
        """Have `task` called before each publication, to set what is costly to keep."""
        self._tasks.append(task)

    def report(self) -> Report:
        """What would be published now, tasks not called."""
        since = self._now() - REJECTION_WARN_TIME
        refused = [topic for topic, r in self._rejections.items() if r.last_at >= since]
        level, sentences = Level.OK, []
        if self._problem is not None:
            level, text = self._problem
            sentences.append(text)
        if refused:
            level = max(level, Level.WARN)
            sentences.append(f"messages refused on {', '.join(sorted(refused))}")
        values = {key: str(value) for key, value in {**self._values, **self._counts}.items()}
        return Report(level, "; ".join(sentences) or "ok", values)

    def publish(self) -> None:
        """Call the tasks and publish, as happens every second anyway."""
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
