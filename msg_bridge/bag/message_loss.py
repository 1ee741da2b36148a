"""Count messages and rows that were sent and not received, without false positives.

Two kinds of sequence numbers show a loss:

- The middleware numbers the messages of each publisher from 1 on. This is exact for a topic with
  one publisher. With several, numbers interleave and a message does not identify its publisher, so
  nothing is counted. A gap counts only if the graph showed the same single publisher before and
  after it and numbers only increased; so publishers that start, end or restart cause no losses.
- Row streams of the exchange number their rows from 1 in each run and session. There rows are
  counted, whatever the number of publishers; a missing row that is sent again no longer counts.
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
_LITTLE_ENDIAN = b"\x00\x01"  # header of little-endian CDR
_UINT16, _UINT32 = struct.Struct("<H"), struct.Struct("<I")
_INTEGER_FORMATS = {4: _UINT16, 6: _UINT32}  # by PointField.datatype
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
            layout = _find_row_layout(data)
            if layout is not None:
                self._streams[topic] = _TopicStreams(layout)
        streams = self._streams.get(topic)
        if streams is None:
            self._numbers[topic].add(number)
        else:
            streams.add(data)

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

    def __init__(self, layout: _RowLayout) -> None:
        self._layout = layout
        self._by_machine: dict[int, _RowStream] = {}

    def add(self, data: bytes) -> None:
        """Add a cloud; one that is malformed or has no numbered rows is ignored."""
        # The bytes of a raw message have not been validated.
        with contextlib.suppress(struct.error):
            self._add(data)

    def _add(self, data: bytes) -> None:
        offset = self._layout.find_rows(data)
        if offset < 0:
            layout = _find_row_layout(data)
            if layout is None:
                return
            self._layout, offset = layout, layout.find_rows(data)
        ids = self._layout.read(data, offset)
        if ids is None:
            return
        machine_id, session, ranges = ids
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
class _RowLayout:
    """Positions of the ids of a cloud's rows in its CDR bytes.

    Attributes:
        head: the bytes from the cloud's fields to `point_step`, equal in all messages of a stream.
        step: size of a row [bytes].
        fields: offset in a row [bytes] and format of each id, by name.
    """

    head: bytes
    step: int
    fields: dict[str, tuple[int, struct.Struct]]

    def find_rows(self, data: bytes) -> int:
        """Return the offset of the rows in a message; -1 if its layout is another one."""
        begin = _fields_offset(data)
        end = begin + len(self.head)
        return end + 8 if data[begin:end] == self.head else -1  # after row_step and length

    def read(
        self, data: bytes, begin: int
    ) -> tuple[int, tuple[int, int], list[tuple[int, int]]] | None:
        """Return (machine id, (run id, session id), ranges of rows as (first, count)).

        Machine and session are 0 where rows are sent to all machines. None if there are no rows.

        Args:
            data: CDR bytes of a message.
            begin: offset of its rows.
        """
        count = _UINT32.unpack_from(data, begin - 4)[0] // self.step
        if count == 0 or begin + count * self.step >= len(data):  # is_dense follows the rows
            return None
        value = {
            name: number.unpack_from(data, begin + offset)[0]
            for name, (offset, number) in self.fields.items()
        }
        session_id = value.get("session_id")
        machine_id = 0 if session_id is None else value.get("machine_id", 0)
        ranges = self._contiguous_ranges(data, begin, count)
        return machine_id, (value["run_id"], session_id or 0), ranges

    def _contiguous_ranges(self, data: bytes, begin: int, count: int) -> list[tuple[int, int]]:
        offset, number = self.fields["seq"]
        first = number.unpack_from(data, begin + offset)[0]
        last = number.unpack_from(data, begin + offset + (count - 1) * self.step)[0]
        if (last - first) % _MODULUS == count - 1:
            return [(first, count)]
        seq = np.ndarray(count, "<u4", data, begin + offset, (self.step,)).astype(np.int64)
        starts = np.flatnonzero(np.diff(seq, prepend=seq[0] - 2) % _MODULUS != 1)
        sizes = np.diff(starts, append=count)
        return [(int(seq[i]), int(n)) for i, n in zip(starts, sizes, strict=True)]


def _fields_offset(data: bytes) -> int:
    """Return the offset of the fields of a PointCloud2, after its header, height and width."""
    frame_id = _UINT32.unpack_from(data, 12)[0]
    return _align(16 + int(frame_id)) + 8


def _align(offset: int) -> int:
    """Round up to a multiple of 4 bytes."""
    return (offset + 3) & ~3


def _find_row_layout(data: bytes) -> _RowLayout | None:
    """Return the layout of a PointCloud2 with numbered rows; None if they are not numbered."""
    if data[:2] != _LITTLE_ENDIAN:
        return None
    fields: dict[str, tuple[int, struct.Struct]] = {}
    try:
        begin = position = _fields_offset(data)
        count, position = _UINT32.unpack_from(data, position)[0], position + 4
        for _ in range(count):
            size = _UINT32.unpack_from(data, position)[0]
            name = data[position + 4 : position + 3 + size].decode()
            position = _align(position + 4 + size)
            offset, datatype = struct.unpack_from("<IB", data, position)
            position += 12  # offset, datatype, count
            if name in _ID_FIELDS and datatype in _INTEGER_FORMATS:
                fields[name] = (offset, _INTEGER_FORMATS[datatype])
        end = position + 8  # is_bigendian, point_step
        step = _UINT32.unpack_from(data, position + 4)[0]
    except (struct.error, UnicodeDecodeError):
        return None
    is_numbered = all(fields.get(name, (0, None))[1] is _UINT32 for name in ("seq", "run_id"))
    is_big_endian = data[position]
    if step == 0 or is_big_endian or not is_numbered:
        return None
    return _RowLayout(data[begin:end], step, fields)
