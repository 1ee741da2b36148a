"""Count messages and rows that were sent and not received, without false positives.

Two kinds of sequence numbers show a loss:

- The middleware numbers the messages of each publisher from 1 on. This is exact for a topic with
  one publisher. With several, numbers interleave and a message does not identify its publisher, so
  nothing is counted. A gap counts only if the graph showed the same single publisher before and
  after it and numbers only increased; so publishers that start, end or restart cause no losses.
- Row streams of the exchange number their rows from 1 in each run and session. There rows are
  counted, for any number of publishers; a missing row that is sent again no longer counts.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np
from sensor_msgs.msg import PointField

from msg_bridge.codec.cdr_primitives import UINT32
from msg_bridge.codec.cloud_layout import CloudLayout, RowBlock, read_cloud_layout
from msg_bridge.exchange.stream_buffers import MAX_ROWS_IN_FLIGHT

__all__ = ["MessageLossCounter"]

_POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
_MODULUS = 2**32
_MAX_OPEN_GAPS = 256
_INTEGER_FORMATS = {PointField.UINT16: struct.Struct("<H"), PointField.UINT32: UINT32}
_ID_FIELDS = ("seq", "run_id", "machine_id", "session_id")


class MessageLossCounter:
    """Counts the losses of every topic."""

    def __init__(self) -> None:
        self._numbers: dict[str, _TopicSequence] = {}
        self._streams: dict[str, _TopicStreams] = {}
        self._unclassified: set[str] = set()  # topics of clouds that may be rows

    def add_topic(self, topic: str, type_name: str) -> None:
        """Add a topic.

        Args:
            topic: its name.
            type_name: as `sensor_msgs/msg/PointCloud2`.
        """
        self._numbers[topic] = _TopicSequence()
        if type_name == _POINT_CLOUD:
            self._unclassified.add(topic)

    def add(self, topic: str, data: bytes, number: int) -> None:
        """Add a received message.

        Args:
            topic: an added topic.
            data: its CDR bytes.
            number: sequence number of its publisher, from 1; 0 if the middleware has none.
        """
        if topic in self._unclassified:
            self._unclassified.discard(topic)
            reader = _RowReader.from_message(data)
            if reader is not None:
                self._streams[topic] = _TopicStreams(reader)
        streams = self._streams.get(topic)
        if streams is None:
            self._numbers[topic].add(number)
        else:
            streams.add(data)

    def add_dropped(self, topic: str, number: int) -> None:
        """Count a message that was received and then dropped.

        Its rows, if they are numbered, are missing rows like those that were not received.

        Args:
            topic, number: as of `add`.
        """
        if topic not in self._streams:
            self._numbers[topic].add(number)
            self._numbers[topic].lost += 1

    def update_publishers(self, topic: str, publishers: frozenset[bytes]) -> None:
        """Update the publishers of a topic from the ROS graph; to be called about every second."""
        self._numbers[topic].update_publishers(publishers)

    @property
    def lost(self) -> dict[str, int]:
        """Number of lost messages, or rows where rows are numbered, of topics with losses."""
        lost = {
            topic: self._streams[topic].lost if topic in self._streams else numbers.lost
            for topic, numbers in self._numbers.items()
        }
        return {topic: count for topic, count in lost.items() if count}

    @property
    def total(self) -> int:
        """Sum of `lost`."""
        return sum(self.lost.values())

    @property
    def uncounted(self) -> tuple[str, ...]:
        """Topics with several publishers, whose losses cannot be counted."""
        return tuple(
            topic
            for topic, numbers in self._numbers.items()
            if topic not in self._streams and len(numbers.publishers) > 1
        )


@dataclass
class _TopicSequence:
    """Sequence numbers of the messages of one topic.

    Attributes:
        publishers: the publishers at the last update.
        lost: number of confirmed losses.
    """

    publishers: frozenset[bytes] = frozenset()
    lost: int = 0
    _last: int = 0  # 0: none yet
    _unconfirmed_lost: int = 0  # since the last update
    _sequence_decreased: bool = False

    def add(self, number: int) -> None:
        """Add the number of a received message."""
        if 0 < self._last < number:
            self._unconfirmed_lost += number - self._last - 1
        elif 0 < number <= self._last:
            self._sequence_decreased = True
        self._last = number

    def update_publishers(self, publishers: frozenset[bytes]) -> None:
        """Confirm the losses since the last update if there was one and the same publisher."""
        is_same_publisher = len(publishers) == 1 and publishers == self.publishers
        if is_same_publisher and not self._sequence_decreased:
            self.lost += self._unconfirmed_lost
        if publishers != self.publishers:
            self._last = 0
        self.publishers = publishers
        self._unconfirmed_lost, self._sequence_decreased = 0, False


class _TopicStreams:
    """The row streams on one topic, one for each machine that publishes there."""

    def __init__(self, reader: _RowReader) -> None:
        self._reader = reader
        self._by_machine: dict[int, _RowStream] = {}

    def add(self, data: bytes) -> None:
        """Add a cloud; one that is malformed or has no numbered rows is ignored."""
        block = self._reader.layout.find_rows(data)
        if block is None:
            reader = _RowReader.from_message(data)
            block = None if reader is None else reader.layout.find_rows(data)
            if reader is None or block is None:
                return
            self._reader = reader
        if block.num_rows:
            self._add_ranges(*self._reader.read(data, block))

    def _add_ranges(
        self, machine_id: int, session: tuple[int, int], ranges: list[tuple[int, int]]
    ) -> None:
        stream = self._by_machine.get(machine_id)
        if stream is None:  # the number of earlier rows is unknown
            stream = self._by_machine[machine_id] = _RowStream(session, ranges[0][0])
        elif session > stream.session:
            stream.begin_session(session)
        elif session < stream.session:
            return
        for first, count in ranges:
            stream.add(first, count)

    @property
    def lost(self) -> int:
        return sum(stream.lost for stream in self._by_machine.values())


@dataclass
class _RowStream:
    """Rows of one sender.

    Attributes:
        session: run id and session id; rows are numbered from 1 in each.
        expected: number of the next row.
    """

    session: tuple[int, int]
    expected: int
    _confirmed_lost: int = 0  # rows that are no longer expected
    _open_gaps: list[tuple[int, int]] = field(default_factory=list)  # (first, last + 1)

    @property
    def lost(self) -> int:
        return self._confirmed_lost + sum(end - begin for begin, end in self._open_gaps)

    def begin_session(self, session: tuple[int, int]) -> None:
        """Continue with a later session."""
        self._confirmed_lost, self._open_gaps = self.lost, []
        self.session, self.expected = session, 1

    def add(self, first: int, count: int) -> None:
        """Add rows `first` to `first + count - 1`, numbered modulo 2**32."""
        ahead = (first - self.expected + _MODULUS // 2) % _MODULUS - _MODULUS // 2
        begin = self.expected + ahead
        end = begin + count
        if ahead > MAX_ROWS_IN_FLIGHT:  # impossible in one stream: the numbering restarted
            self.expected = end
            return
        if ahead > 0:
            self._open_gaps.append((self.expected, begin))
            if len(self._open_gaps) > _MAX_OPEN_GAPS:
                oldest = self._open_gaps.pop(0)
                self._confirmed_lost += oldest[1] - oldest[0]
        elif self._open_gaps:
            self._close_gaps(begin, end)
        self.expected = max(self.expected, end)

    def _close_gaps(self, begin: int, end: int) -> None:
        """Remove rows `begin` to `end - 1` from the gaps."""
        remaining = []
        for low, high in self._open_gaps:
            remaining += [(low, min(high, begin)), (max(low, end), high)]
        self._open_gaps = [(low, high) for low, high in remaining if low < high]


@dataclass(frozen=True)
class _RowReader:
    """Reads the ids in the rows of serialised clouds of one layout.

    Attributes:
        layout: the layout.
        ids: offset in a row [bytes] and format of each id, by name.
    """

    layout: CloudLayout
    ids: dict[str, tuple[int, struct.Struct]]

    @classmethod
    def from_message(cls, data: bytes) -> _RowReader | None:
        """Return a reader for the layout of a PointCloud2; None if its rows are not numbered."""
        layout = read_cloud_layout(data)
        if layout is None:
            return None
        ids = {
            each.name: (each.offset, _INTEGER_FORMATS[each.datatype])
            for each in layout.fields
            if each.name in _ID_FIELDS and each.datatype in _INTEGER_FORMATS
        }
        is_numbered = all(ids.get(name, (0, None))[1] is UINT32 for name in ("seq", "run_id"))
        is_within_row = all(offset + form.size <= layout.step for offset, form in ids.values())
        return cls(layout, ids) if is_numbered and is_within_row else None

    def read(
        self, data: bytes, block: RowBlock
    ) -> tuple[int, tuple[int, int], list[tuple[int, int]]]:
        """Return (machine id, (run id, session id), ranges of rows as (first, count)).

        Machine and session are 0 where rows are sent to all machines.

        Args:
            data: CDR bytes of a message.
            block: its rows, at least one.
        """
        value = {
            name: form.unpack_from(data, block.offset + offset)[0]
            for name, (offset, form) in self.ids.items()
        }
        session_id = value.get("session_id")
        machine_id = 0 if session_id is None else value.get("machine_id", 0)
        ranges = self._contiguous_ranges(data, block)
        return machine_id, (value["run_id"], session_id or 0), ranges

    def _contiguous_ranges(self, data: bytes, block: RowBlock) -> list[tuple[int, int]]:
        offset, form = self.ids["seq"]
        begin, step, count = block.offset + offset, self.layout.step, block.num_rows
        (first,) = form.unpack_from(data, begin)
        (last,) = form.unpack_from(data, begin + (count - 1) * step)
        if (last - first) % _MODULUS == count - 1:
            return [(first, count)]
        seq = np.ndarray(count, "<u4", data, begin, (step,)).astype(np.int64)
        starts = np.flatnonzero(np.diff(seq, prepend=seq[0] - 2) % _MODULUS != 1)
        sizes = np.diff(starts, append=count)
        return [(int(seq[i]), int(n)) for i, n in zip(starts, sizes, strict=True)]
