"""CommandConflicts: reports several publishers that command the same joints or tracks."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

from rclpy.node import Node

from machine_sim.commands.conflict_detector import CommandConflict, ConflictDetector
from machine_sim.commands.parser import Setpoints
from machine_sim.node.machine_instance import MachineInstance
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.endpoint_monitor import node_name

__all__ = ["CommandConflicts"]

_CONDITION = "command conflict"


class _Publisher(NamedTuple):
    """A publisher of commands: its topic, its node, and its id."""

    topic: str
    node_name: str
    gid: tuple[int, ...]


class CommandConflicts:
    """Reports the command conflicts of the machines of a node, in its log and diagnostics."""

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        instances: Sequence[MachineInstance],
        *,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            node: the machine node.
            diagnostics: its diagnostics.
            instances: its machines.
            now: monotonic wall clock [s].
        """
        self._node, self._diagnostics, self._now = node, diagnostics, now
        self._instances = instances
        self._detectors = [ConflictDetector() for _ in instances]
        self._found: list[set[_Publisher]] = [set() for _ in instances]  # while a conflict lasts
        diagnostics.add_task(self.update)

    def record(self, machine: int, topic: str, number: int | None, setpoints: Setpoints) -> None:
        """Record a command of a machine; arguments as for `ConflictDetector.record`.

        Args:
            machine: index of the machine.
            topic, number, setpoints: the command.
        """
        self._detectors[machine].record(topic, number, setpoints, self._now())

    def update(self) -> None:
        """Report the conflicts that have begun or ended."""
        texts = []
        for k, detector in enumerate(self._detectors):
            conflict = detector.find(self._now())
            text = self._describe(k, conflict) if conflict is not None else ""
            if text:
                texts.append(text)
            elif self._found[k]:
                self._found[k].clear()
                self._node.get_logger().info(f"commands of {self._name(k)} no longer alternate")
        if texts:
            self._diagnostics.problem("; ".join(texts), condition=_CONDITION)
        else:
            self._diagnostics.clear(_CONDITION)

    def _describe(self, k: int, conflict: CommandConflict) -> str:
        """Return a sentence on the conflict of machine `k`, and log it if a publisher is new.

        Empty if fewer than two publishers are known: one of them has ended, or is not discovered.
        """
        publishers = self._found[k] | set(self._publishers(conflict.topics))
        if len(publishers) < 2:
            return ""
        names = self._instances[k].command_names
        actuators = ", ".join(names[i] for i in conflict.actuators)
        text = (
            f"several publishers command {self._name(k)} in turn ({actuators}):"
            f" {_list(publishers)}; stop all but one"
        )
        if publishers != self._found[k]:
            self._found[k] = publishers
            self._node.get_logger().warning(text)
        return text

    def _publishers(self, topics: Sequence[str]) -> list[_Publisher]:
        """Return the publishers of command topics."""
        found = []
        for topic in topics:
            full_name = self._node.resolve_topic_name(topic)
            for info in self._node.get_publishers_info_by_topic(full_name):
                gid = tuple(info.endpoint_gid)
                found.append(_Publisher(full_name, node_name(info), gid))
        return found

    def _name(self, k: int) -> str:
        return self._instances[k].name or "the machine"


def _list(publishers: set[_Publisher]) -> str:
    """Return nodes and topics, with the number of publishers that a node has on one topic: several
    nodes may have the same name.
    """
    counts = Counter((each.node_name, each.topic) for each in publishers)
    return ", ".join(
        f"{count} publishers of {name} on {topic}" if count > 1 else f"{name} on {topic}"
        for (name, topic), count in sorted(counts.items())
    )
