"""What a machine node did, in its order: join requests, and ticks with the commands in force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from earthmoving_sim.replay.errors import ReplayError
from earthmoving_sim.replay.recorded.run_survey import SessionId
from earthmoving_sim.replay.recorded.topic_queues import TopicQueues
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract import topics
from msg_bridge.contract.messages import MachineHeader
from msg_bridge.contract.topics import resolve

__all__ = ["NodeAction", "RecordedNode", "node_topics"]


@dataclass(frozen=True, eq=False)
class NodeAction:
    """A join request, or a tick.

    Attributes:
        header: its header.
        commands: velocities of the joints [rad/s] and tracks [m/s] by name, of each machine of the
            node; empty for a join request.
    """

    header: MachineHeader
    commands: tuple[Mapping[str, float], ...] = ()

    @property
    def session(self) -> SessionId:
        """The session that it belongs to."""
        return SessionId(self.header.machine_id, self.header.session_id)


class RecordedNode:
    """The actions of one machine node in all runs of a bag.

    Attributes:
        namespace: namespace of the node.
    """

    def __init__(
        self,
        queues: TopicQueues,
        namespace: str,
        machines: Sequence[str],
        tick_periods: Mapping[int, float],
    ) -> None:
        """
        Args:
            queues: messages of the bag.
            namespace: namespace of the node.
            machines: names of its machines; one empty name for the only machine of a node.
            tick_periods: tick period of each run of the bag [s], by run id.
        """
        self.namespace = namespace
        self._queues, self._periods = queues, tick_periods
        self._header_topic = resolve(topics.MACHINE_TICK, namespace)
        self._command_topics = _command_topics(namespace, machines)
        self._newest: MachineHeader | None = None
        self._last_skipped: MachineHeader | None = None  # while actions are left out

    @property
    def newest_header(self) -> MachineHeader | None:
        """Header of the last action."""
        return self._last_skipped or self._newest

    def skip_through(self, header: MachineHeader) -> None:
        """Leave out all actions up to the one with a header."""
        self._last_skipped = header

    def next_action(self) -> NodeAction | None:
        """Return the next action; None at the end of the bag. Repeated headers are left out.

        Raises:
            ReplayError: a command is missing.
            BagReadError: the bag is damaged.
        """
        while True:
            message = self._queues.next(self._header_topic)
            if message is None:
                return None
            header = _machine_header(message)
            if header is None:
                continue
            if self._is_repeated(header):
                continue
            self._newest = header
            commands: list[Mapping[str, float]] = []
            if header.is_tick and header.run_id in self._periods:
                commands = [self._command(topic, header) for topic in self._command_topics]
            if self._last_skipped is None:
                return NodeAction(header, tuple(commands))
            if header == self._last_skipped:
                self._last_skipped = None

    def _is_repeated(self, header: MachineHeader) -> bool:
        newest = self._newest
        if newest is None or newest.run_id != header.run_id:
            return False
        if newest.session_id != header.session_id:
            return header.is_tick  # a tick of a session that is over
        return not header.is_tick or (newest.is_tick and header.tick <= newest.tick)

    def _command(self, topic: str, header: MachineHeader) -> Mapping[str, float]:
        """Return the command that a machine applied in the tick of a header.

        Each tick of each machine has one message, so those of ticks that no header names are
        skipped. Those of earlier runs, which have the same stamps, must be read before.
        """
        stamp = stamp_from_tick(header.tick, self._periods[header.run_id])
        while (message := self._queues.next(topic)) is not None:
            if message.header.stamp == stamp:
                return dict(zip(message.name, message.velocity, strict=False))
        raise ReplayError(
            f"the bag lacks the command of tick {header.tick} on {topic}; record it without loss"
        )


def node_topics(namespace: str, machines: Sequence[str]) -> dict[str, str]:
    """Return the type of each topic of a node that is read, by its name."""
    commands = dict.fromkeys(_command_topics(namespace, machines), "sensor_msgs/msg/JointState")
    return {resolve(topics.MACHINE_TICK, namespace): "std_msgs/msg/Int64MultiArray", **commands}


def _command_topics(namespace: str, machines: Sequence[str]) -> list[str]:
    """Return the topic of the applied commands of each machine of a node."""
    return [
        resolve(f"{name}/{topics.APPLIED_COMMANDS}" if name else topics.APPLIED_COMMANDS, namespace)
        for name in machines
    ]


def _machine_header(message: Any) -> MachineHeader | None:
    try:
        header = from_multi_array(message)
    except CodecError:
        return None
    return header if isinstance(header, MachineHeader) else None
