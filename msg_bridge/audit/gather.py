"""Gathering what an audit needs from a bag, sorted by run, in whatever order it was recorded."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from msg_bridge.audit.keyframes import Keyframes
from msg_bridge.audit.report import Check, Finding
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.chunks import from_chunk_cloud
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.headers import from_multi_array
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, SoilHeader, Stream, Verb
from msg_bridge.contract.rows import Rows

__all__ = ["EpochData", "Gathered", "Life", "StreamKey", "gather"]

Life = tuple[int, int]
"""(source, life)."""

StreamKey = tuple[Stream, int, int]
"""(stream, source, life); 0, 0 for what the soil sends to all."""

_ROW_TOPICS = {
    "/soil/conversions": Stream.CONVERSION,
    "/terrain/changes": Stream.CHANGED,
    "/soil/forces": Stream.FORCE,
    "/soil/tool_sweeps": Stream.SWEEP,
    "/soil/landed": Stream.LANDED,
}
_KEYFRAMES = "/terrain/map"
_SOIL_HEADERS = "/soil/tick"
_LEDGER = "/soil/ledger"
_MACHINE_HEADERS = "/soil_tick"  # below each machine's namespace
_OWED = "/soil_owed"  # likewise

_PROGRESS_STEPS = 100


@dataclass
class EpochData:
    """All of one run.

    Attributes:
        soil: soil headers by tick.
        steps: machine headers with verb STEP or LEAVE by life and tick.
        joins: machine headers with verb JOIN or RETURN by life.
        chunks: rows as they came, by stream.
        keyframes: terrain maps.
        ledgers: by tick.
        findings: headers that contradict one another.
    """

    soil: dict[int, SoilHeader] = field(default_factory=dict)
    steps: dict[Life, dict[int, MachineHeader]] = field(default_factory=dict)
    joins: dict[Life, MachineHeader] = field(default_factory=dict)
    chunks: dict[StreamKey, list[Rows]] = field(default_factory=lambda: defaultdict(list))
    keyframes: Keyframes = field(default_factory=Keyframes)
    ledgers: dict[int, Ledger] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)


@dataclass
class Gathered:
    """All of a bag.

    Attributes:
        epochs: by number.
        topics: those of the exchange that the bag has.
        messages: how many were read.
        findings: messages that cannot be read, and ledgers of no run.
    """

    epochs: dict[int, EpochData]
    topics: frozenset[str]
    messages: int
    findings: list[Finding]


def gather(reader: BagReader, progress: Callable[[float], None] | None = None) -> Gathered:
    """Read all messages of the exchange.

    Args:
        reader: the bag.
        progress: told now and then which part [0, 1] is read.

    Raises:
        BagReadError: the file is damaged, or a message type is not installed.
    """
    collector = _Collector()
    topics = frozenset(name for name in reader.topics if collector.handler(name) is not None)
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
                collector.unreadable(topic, time, str(error))
    return collector.finish(topics, read)


class _Collector:
    """Puts each message where it belongs."""

    def __init__(self) -> None:
        self._epochs: dict[int, EpochData] = defaultdict(EpochData)
        self._ledgers: list[tuple[int, Ledger]] = []
        self._soil_times: dict[int, dict[int, int]] = defaultdict(dict)  # by tick, by epoch
        self._unreadable: dict[str, list[tuple[int, str]]] = defaultdict(list)
        self._last_map: Any = None

    def handler(self, topic: str) -> Callable[[str, int, Any], None] | None:
        """What takes messages of a topic; None if the audit does not need it."""
        if topic in _ROW_TOPICS or topic.endswith(_OWED):
            return self._rows
        if topic == _SOIL_HEADERS or topic.endswith(_MACHINE_HEADERS):
            return self._header
        return {_KEYFRAMES: self._keyframe, _LEDGER: self._ledger}.get(topic)

    def unreadable(self, topic: str, time: int, reason: str) -> None:
        self._unreadable[topic].append((time, reason))

    def finish(self, topics: frozenset[str], messages: int) -> Gathered:
        findings = [
            Finding(
                Check.COMPLETENESS,
                f"{len(wrong)} message(s) on {topic} cannot be read; the first, logged at"
                f" {wrong[0][0]} ns: {wrong[0][1]}. If another version recorded the bag, audit it"
                " with that one",
            )
            for topic, wrong in self._unreadable.items()
        ]
        orphans = [ledger.tick for time, ledger in self._ledgers if not self._file(time, ledger)]
        if orphans and self._soil_times:
            findings.append(
                Finding(
                    Check.LEDGER,
                    f"{len(orphans)} ledger(s) are of ticks without a soil header, the first of"
                    f" tick {orphans[0]}",
                    min(orphans),
                    max(orphans),
                )
            )
        return Gathered(dict(sorted(self._epochs.items())), topics, messages, findings)

    def _rows(self, topic: str, time: int, message: Any) -> None:
        chunk = from_chunk_cloud(message, _ROW_TOPICS.get(topic, Stream.OWED))
        key = (chunk.stream, chunk.source, chunk.life)
        self._epochs[chunk.epoch].chunks[key].append(chunk.rows)

    def _header(self, topic: str, time: int, message: Any) -> None:
        header = from_multi_array(message)
        if isinstance(header, SoilHeader):
            data = self._epochs[header.epoch]
            self._soil_times[header.tick].setdefault(header.epoch, time)
            self._keep(data, data.soil, header.tick, header, "the soil", header.tick)
        elif isinstance(header, MachineHeader):
            data = self._epochs[header.epoch]
            life = (header.source, header.life)
            who = f"machine {header.source}, life {header.life},"
            if header.verb in (Verb.JOIN, Verb.RETURN):
                self._keep(data, data.joins, life, header, who, header.tick)
            else:
                steps = data.steps.setdefault(life, {})
                self._keep(data, steps, header.tick, header, who, header.tick)

    def _keep(
        self, data: EpochData, where: dict[Any, Any], key: Any, header: Any, who: str, tick: int
    ) -> None:
        """Keep the first of equal headers; others of the same tick contradict it."""
        if where.setdefault(key, header) != header:
            text = f"{who} sent two different headers of tick {tick}"
            data.findings.append(Finding(Check.COMPLETENESS, text, tick, tick))

    def _keyframe(self, topic: str, time: int, message: Any) -> None:
        if message == self._last_map:  # written again for those who read a part of the bag
            return
        terrain = from_terrain_cloud(message)
        self._epochs[terrain.keyframe.epoch].keyframes.add(terrain)
        self._last_map = message

    def _ledger(self, topic: str, time: int, message: Any) -> None:
        ledger = from_multi_array(message)
        if isinstance(ledger, Ledger):
            self._ledgers.append((time, ledger))

    def _file(self, time: int, ledger: Ledger) -> bool:
        """Ledgers do not say their epoch: it is that of the soil header logged nearest to it."""
        times = self._soil_times.get(ledger.tick)
        if not times:
            return False
        epoch = min(times, key=lambda each: abs(times[each] - time))
        data = self._epochs[epoch]
        self._keep(data, data.ledgers, ledger.tick, ledger, "the ledger", ledger.tick)
        return True
