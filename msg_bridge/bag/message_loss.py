"""Counts what was sent and did not arrive, and never what did not get lost.

Two numberings tell of a loss:

- A publisher numbers its messages from 1 on, below ROS. That is exact for a topic of one publisher.
  With several, numbers interleave and a message does not say whose it is: nothing is counted then.
  A jump counts only when the graph has shown the same single publisher before and after it, and
  numbers only went up meanwhile; so publishers that come, go and start again are no gaps.
- Streams of the exchange number their rows, from 1 in every run (epoch) and life, whoever else
  sends on that topic. There rows are counted; one that was missing and is sent again is no longer.
"""

from __future__ import annotations

import contextlib
import struct
from dataclasses import dataclass, field

import numpy as np

from msg_bridge.exchange.stream_buffers import MAX_ROWS_IN_FLIGHT

__all__ = ["MessageLossCounter"]

_POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
_MODULUS = 2**32
_MAX_OPEN_GAPS = 256
_LITTLE_ENDIAN = b"\x00\x01"  # how CDR begins
_UINT16, _UINT32 = struct.Struct("<H"), struct.Struct("<I")
_INTEGER_FORMATS = {4: _UINT16, 6: _UINT32}  # by PointField.datatype


class MessageLossCounter:
    """Losses of every topic."""

    def __init__(self) -> None:
        self._numbers: dict[str, _TopicSequence] = {}
        self._streams: dict[str, _TopicStreams] = {}
        self._unclassified: set[str] = set()  # clouds that may be rows

    def add_topic(self, topic: str, type_name: str) -> None:
        """Begin to watch a topic."""
        self._numbers[topic] = _TopicSequence()
        if type_name == _POINT_CLOUD:
            self._unclassified.add(topic)

    def add(self, topic: str, data: bytes, number: int) -> None:
        """Take a message that arrived.

        Args:
            topic: one that was added.
            data: its CDR.
            number: its publisher's, from 1; 0 if the middleware tells none.
        """
        if topic in self._unclassified:
            self._unclassified.discard(topic)
            layout = _find_row_layout(data)
            if layout is not None:
                self._streams[topic] = _TopicStreams(layout)
        streams = self._streams.get(topic)
        if streams is None:
            self._numbers[topic].add(number)
        else:
            streams.add(data)

    def update_publishers(self, topic: str, publishers: frozenset[bytes]) -> None:
        """Take the identities of a topic's publishers now; to be called about every second."""
        self._numbers[topic].update_publishers(publishers)

    @property
    def lost(self) -> dict[str, int]:
        """Messages lost, rows where rows are numbered; of topics that lost any."""
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
        """Topics of several publishers, of whose losses nothing can be told."""
        return tuple(
            topic
            for topic, numbers in self._numbers.items()
            if topic not in self._streams and len(numbers.publishers) > 1
        )


@dataclass
class _TopicSequence:
    """A topic's messages by their publisher's numbers.

    Attributes:
        publishers: when last seen.
        lost: confirmed losses.
    """

    publishers: frozenset[bytes] = frozenset()
    lost: int = 0
    _last: int = 0  # 0: none yet
    _unconfirmed_lost: int = 0  # missing since the publishers were last seen
    _sequence_decreased: bool = False

    def add(self, number: int) -> None:
        if 0 < self._last < number:
            self._unconfirmed_lost += number - self._last - 1
        elif 0 < number <= self._last:
            self._sequence_decreased = True
        self._last = number

    def update_publishers(self, publishers: frozenset[bytes]) -> None:
        one_and_the_same = len(publishers) == 1 and publishers == self.publishers
        if one_and_the_same and not self._sequence_decreased:
            self.lost += self._unconfirmed_lost
        if publishers != self.publishers:
            self._last = 0
        self.publishers = publishers
        self._unconfirmed_lost, self._sequence_decreased = 0, False


class _TopicStreams:
    """The streams of rows on one topic, one for each machine that sends there."""

    def __init__(self, layout: _RowLayout) -> None:
        self._layout = layout
        self._by_machine: dict[int, _RowStream] = {}

    def add(self, data: bytes) -> None:
        """Take a cloud; one that is malformed or has no numbered rows says nothing."""
        # Nothing has looked into the bytes of a raw message before.
        with contextlib.suppress(struct.error):
            self._add(data)

    def _add(self, data: bytes) -> None:
        at = self._layout.find(data)
        if at < 0:
            layout = _find_row_layout(data)
            if layout is None:
                return
            self._layout, at = layout, layout.find(data)
        found = self._layout.read(data, at)
        if found is None:
            return
        machine_id, session_id, runs = found
        stream = self._by_machine.get(machine_id)
        if stream is None:  # nothing tells how many came before
            stream = self._by_machine[machine_id] = _RowStream(session_id, runs[0][0])
        elif session_id > stream.session_id:
            stream.begin(session_id)
        elif session_id < stream.session_id:
            return
        for first, count in runs:
            stream.add(first, count)

    @property
    def lost(self) -> int:
        return sum(stream.lost for stream in self._by_machine.values())


@dataclass
class _RowStream:
    """Rows of one sender.

    Attributes:
        life: its epoch and life; rows count from 1 in each.
        expected: number of the next row.
    """

    session_id: tuple[int, int]
    expected: int
    _confirmed_lost: int = 0  # lost for good
    _open_gaps: list[tuple[int, int]] = field(default_factory=list)  # first, and last + 1

    @property
    def lost(self) -> int:
        return self._confirmed_lost + sum(end - begin for begin, end in self._open_gaps)

    def begin(self, session_id: tuple[int, int]) -> None:
        """Go on with a later life."""
        self._confirmed_lost, self._open_gaps = self.lost, []
        self.session_id, self.expected = session_id, 1

    def add(self, first: int, count: int) -> None:
        """Take rows `first` to `first + count - 1`, numbered modulo 2**32."""
        ahead = (first - self.expected + _MODULUS // 2) % _MODULUS - _MODULUS // 2
        begin = self.expected + ahead
        end = begin + count
        if ahead > MAX_ROWS_IN_FLIGHT:  # no stream does that: somebody counts from another start
            self.expected = end
            return
        if ahead > 0:
            self._open_gaps.append((self.expected, begin))
            if len(self._open_gaps) > _MAX_OPEN_GAPS:
                old = self._open_gaps.pop(0)
                self._confirmed_lost += old[1] - old[0]
        elif self._open_gaps:
            self._close_gaps(begin, end)
        self.expected = max(self.expected, end)

    def _close_gaps(self, begin: int, end: int) -> None:
        """Take rows that were missing."""
        left = []
        for low, high in self._open_gaps:
            left += [(low, min(high, begin)), (max(low, end), high)]
        self._open_gaps = [(low, high) for low, high in left if low < high]


@dataclass(frozen=True)
class _RowLayout:
    """Where the numbers of a cloud's rows are in its CDR.

    Attributes:
        head: the message from its fields to `point_step`, the same in all messages of a stream.
        step: bytes of a row.
        fields: offset in a row, and how to read it, by name.
    """

    head: bytes
    step: int
    fields: dict[str, tuple[int, struct.Struct]]

    def find(self, data: bytes) -> int:
        """Where the rows of a message of this layout begin; -1 if it is of another."""
        begin = _fields_offset(data)
        end = begin + len(self.head)
        return end + 8 if data[begin:end] == self.head else -1  # row_step and length between

    def read(
        self, data: bytes, at: int
    ) -> tuple[int, tuple[int, int], list[tuple[int, int]]] | None:
        """(source, (epoch, life), runs of consecutive rows as (first, count)); None if no rows.

        Source and life are 0 where rows are sent to all.
        """
        count = _UINT32.unpack_from(data, at - 4)[0] // self.step
        if count == 0 or at + count * self.step >= len(data):  # is_dense comes after the rows
            return None
        value = {
            name: reader.unpack_from(data, at + offset)[0]
            for name, (offset, reader) in self.fields.items()
        }
        session_id = value.get("session_id")
        machine_id = 0 if session_id is None else value.get("machine_id", 0)
        return machine_id, (value["run_id"], session_id or 0), self._runs(data, at, count)

    def _runs(self, data: bytes, at: int, count: int) -> list[tuple[int, int]]:
        offset, reader = self.fields["seq"]
        first = reader.unpack_from(data, at + offset)[0]
        last = reader.unpack_from(data, at + offset + (count - 1) * self.step)[0]
        if (last - first) % _MODULUS == count - 1:
            return [(first, count)]
        seq = np.ndarray(count, "<u4", data, at + offset, (self.step,)).astype(np.int64)
        starts = np.flatnonzero(np.diff(seq, prepend=seq[0] - 2) % _MODULUS != 1)
        sizes = np.diff(starts, append=count)
        return [(int(seq[i]), int(n)) for i, n in zip(starts, sizes, strict=True)]


def _fields_offset(data: bytes) -> int:
    """Where the fields of a PointCloud2 begin: after its header of variable length, and sizes."""
    frame_id = _UINT32.unpack_from(data, 12)[0]
    return _align(16 + int(frame_id)) + 8


def _align(at: int) -> int:
    return (at + 3) & ~3


def _find_row_layout(data: bytes) -> _RowLayout | None:
    """The layout of a PointCloud2 whose rows are numbered; None if they are not."""
    if data[:2] != _LITTLE_ENDIAN:
        return None
    fields: dict[str, tuple[int, struct.Struct]] = {}
    try:
        begin = at = _fields_offset(data)
        count, at = _UINT32.unpack_from(data, at)[0], at + 4
        for _ in range(count):
            size = _UINT32.unpack_from(data, at)[0]
            name = data[at + 4 : at + 3 + size].decode()
            at = _align(at + 4 + size)
            offset, datatype = struct.unpack_from("<IB", data, at)
            at += 12
            if (
                name in ("seq", "run_id", "machine_id", "session_id")
                and datatype in _INTEGER_FORMATS
            ):
                fields[name] = (offset, _INTEGER_FORMATS[datatype])
        end = at + 8  # is_bigendian, point_step
        step = _UINT32.unpack_from(data, at + 4)[0]
    except (struct.error, UnicodeDecodeError):
        return None
    numbered = all(fields.get(name, (0, None))[1] is _UINT32 for name in ("seq", "run_id"))
    if step == 0 or data[at] or not numbered:  # data[at]: is_bigendian
        return None
    return _RowLayout(data[begin:end], step, fields)
