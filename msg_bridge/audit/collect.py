"""Collect from a bag the messages that an audit needs, sorted by run, in any recorded order."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from msg_bridge.audit.keyframes import Keyframes
from msg_bridge.audit.report import Check, Finding
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.row_chunks import from_chunk_cloud
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, SoilHeader, Stream, Verb
from msg_bridge.contract.rows import Rows

__all__ = ["CollectedMessages", "RunData", "SessionKey", "StreamKey", "collect_messages"]


class SessionKey(NamedTuple):
    """A machine's participation from one join to the next."""

    machine_id: int
    session_id: int


class StreamKey(NamedTuple):
    """A stream of rows; machine and session are 0 for what the soil sends to all machines."""

    stream: Stream
    machine_id: int = 0
    session_id: int = 0


_ROW_TOPICS = {
    "/soil/conversions": Stream.CONVERSION,
    "/terrain/map_updates": Stream.MAP_UPDATE,
    "/soil/forces": Stream.FORCE,
    "/soil/tool_sweeps": Stream.SWEEP,
    "/soil/deposit_requests": Stream.DEPOSIT_REQUEST,
}
_KEYFRAME_TOPIC = "/terrain/map"
_SOIL_HEADER_TOPIC = "/soil/tick"
_LEDGER_TOPIC = "/soil/ledger"
# In the namespace of each machine:
_MACHINE_HEADER_SUFFIX = "/soil_tick"
_BACKLOG_SUFFIX = "/conversion_backlog"

_PROGRESS_STEPS = 100


@dataclass
class RunData:
    """Messages of one run.

    Attributes:
        soil: soil headers by tick.
        steps: machine headers with verb STEP or LEAVE, by session and tick.
        joins: machine headers with verb JOIN or REJOIN, by session.
        chunks: rows as recorded, by stream.
        keyframes: the terrain maps.
        ledgers: the published ledgers, by tick.
        findings: headers that contradict one another.
    """

    soil: dict[int, SoilHeader] = field(default_factory=dict)
    steps: dict[SessionKey, dict[int, MachineHeader]] = field(default_factory=dict)
    joins: dict[SessionKey, MachineHeader] = field(default_factory=dict)
    chunks: dict[StreamKey, list[Rows]] = field(default_factory=lambda: defaultdict(list))
    keyframes: Keyframes = field(default_factory=Keyframes)
    ledgers: dict[int, Ledger] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)


@dataclass
class CollectedMessages:
    """Messages of a bag.

    Attributes:
        runs: messages of each run, by its number.
        topics: the topics that were read.
        messages: number of messages read.
        findings: messages that cannot be decoded, and ledgers that belong to no run.
    """

    runs: dict[int, RunData]
    topics: frozenset[str]
    messages: int
    findings: list[Finding]


def collect_messages(
    reader: BagReader, progress: Callable[[float], None] | None = None
) -> CollectedMessages:
    """Read all messages that the audit needs.

    Args:
        reader: the bag.
        progress: called now and then with the fraction read [0..1].

    Raises:
        BagReadError: the file is damaged, or a message type is not installed.
    """
    collector = _Collector()
    topics = frozenset(
        name
        for name in reader.topics
        if collector.handler(name) is not None and reader.is_of_simulation(name)
    )
    total = sum(reader.topics[name].count for name in topics)
    step = max(1, total // _PROGRESS_STEPS)
    read = 0
    if topics:
        for topic, time, message in reader.messages(topics):
            read += 1
            if progress is not None and read % step == 0:
                progress(read / total)
            handler = collector.handler(topic)
            assert handler is not None
            try:
                handler(topic, time, message)
            except (CodecError, AttributeError) as error:  # AttributeError: another message type
                collector.add_unreadable(topic, time, str(error))
    return collector.finish(topics, read)


class _Collector:
    """Sorts messages by run, stream and tick."""

    def __init__(self) -> None:
        self._runs_by_id: dict[int, RunData] = defaultdict(RunData)
        self._ledgers: list[Ledger] = []
        self._unreadable_messages: dict[str, list[tuple[int, str]]] = defaultdict(list)
        self._last_map: Any = None

    def handler(self, topic: str) -> Callable[[str, int, Any], None] | None:
        """Return the method that stores messages of a topic; None if the audit does not need it."""
        if topic in _ROW_TOPICS or topic.endswith(_BACKLOG_SUFFIX):
            return self._handle_rows
        if topic == _SOIL_HEADER_TOPIC or topic.endswith(_MACHINE_HEADER_SUFFIX):
            return self._handle_header
        return {_KEYFRAME_TOPIC: self._handle_keyframe, _LEDGER_TOPIC: self._handle_ledger}.get(
            topic
        )

    def add_unreadable(self, topic: str, time: int, reason: str) -> None:
        self._unreadable_messages[topic].append((time, reason))

    def finish(self, topics: frozenset[str], messages: int) -> CollectedMessages:
        findings = [
            Finding(
                Check.COMPLETENESS,
                f"{len(wrong)} message(s) on {topic} cannot be decoded; the first, logged at"
                f" {wrong[0][0]} ns: {wrong[0][1]}. If another version recorded the bag, audit it"
                " with that version",
            )
            for topic, wrong in self._unreadable_messages.items()
        ]
        orphans = [ledger.tick for ledger in self._ledgers if not self._store_ledger(ledger)]
        if orphans and any(data.soil for data in self._runs_by_id.values()):
            findings.append(
                Finding(
                    Check.LEDGER,
                    f"{len(orphans)} ledger(s) are of ticks without a soil header, the first of"
                    f" tick {orphans[0]}",
                    min(orphans),
                    max(orphans),
                )
            )
        return CollectedMessages(dict(sorted(self._runs_by_id.items())), topics, messages, findings)

    def _handle_rows(self, topic: str, time: int, message: Any) -> None:
        chunk = from_chunk_cloud(message, _ROW_TOPICS.get(topic, Stream.BACKLOG))
        key = StreamKey(chunk.stream, chunk.machine_id, chunk.session_id)
        self._runs_by_id[chunk.run_id].chunks[key].append(chunk.rows)

    def _handle_header(self, topic: str, time: int, message: Any) -> None:
        header = from_multi_array(message)
        if isinstance(header, SoilHeader):
            data = self._runs_by_id[header.run_id]
            self._store_header(data, data.soil, header.tick, header, "the soil", header.tick)
        elif isinstance(header, MachineHeader):
            data = self._runs_by_id[header.run_id]
            session = SessionKey(header.machine_id, header.session_id)
            sender = f"machine {header.machine_id}, session {header.session_id},"
            if header.verb in (Verb.JOIN, Verb.REJOIN):
                self._store_header(data, data.joins, session, header, sender, header.tick)
            else:
                steps = data.steps.setdefault(session, {})
                self._store_header(data, steps, header.tick, header, sender, header.tick)

    def _store_header(
        self, data: RunData, stored: dict[Any, Any], key: Any, header: Any, sender: str, tick: int
    ) -> None:
        """Store the first header of a tick; a different one of the same tick contradicts it."""
        if stored.setdefault(key, header) != header:
            text = f"{sender} sent two different headers of tick {tick}"
            data.findings.append(Finding(Check.COMPLETENESS, text, tick, tick))

    def _handle_keyframe(self, topic: str, time: int, message: Any) -> None:
        if message == self._last_map:  # repeated for readers of a part of the bag
            return
        terrain = from_terrain_cloud(message)
        self._runs_by_id[terrain.keyframe.run_id].keyframes.add(terrain)
        self._last_map = message

    def _handle_ledger(self, topic: str, time: int, message: Any) -> None:
        ledger = from_multi_array(message)
        if isinstance(ledger, Ledger):
            self._ledgers.append(ledger)

    def _store_ledger(self, ledger: Ledger) -> bool:
        """Store a ledger in its run; return False if there is no soil header of its tick."""
        data = self._runs_by_id.get(ledger.run_id)
        if data is None or ledger.tick not in data.soil:
            return False
        self._store_header(data, data.ledgers, ledger.tick, ledger, "the ledger", ledger.tick)
        return True
