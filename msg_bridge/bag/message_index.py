"""Random access to the messages of a bag, in the order in which `BagReader` returns them.

An MCAP file has an index behind each chunk with time and place of each message. Where it is
missing (the recorder was killed), the chunk is decompressed and scanned.
"""

from __future__ import annotations

import struct
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk
from mcap.stream_reader import get_chunk_data_stream
from numpy.typing import NDArray

from msg_bridge.bag.compressed_message import decompress_message
from msg_bridge.bag.mcap_index import BagReadError, FileSegment, McapFile, damage
from msg_bridge.bag.mcap_records import MESSAGE_HEADER, RECORD_HEADER, records_in
from msg_bridge.bag.terrain_deltas import has_deltas
from msg_bridge.codec.terrain_delta import apply_delta

__all__ = ["MessageIndex"]

_INDEX_HEADER = struct.Struct("<HI")  # channel, size of the entries
_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])

_MAX_KEYFRAMES = 3
"""Number of full maps that are tried for a delta. It is based on the last one, unless messages of
two runs alternate because their log times are simulation times."""

_MAX_CACHE_SIZE = 96 * 2**20
"""Maximum size of the decompressed chunks that are kept [bytes]."""


class MessageIndex:
    """The messages of some topics, numbered in order of their log time.

    It is used by one thread, and closed at the end.

    Attributes:
        topics: names of the topics.
        times: log time of each message [ns], shape (n,), int64, ascending.
        topic_numbers: index in `topics` of each message, shape (n,), int64.
    """

    def __init__(
        self,
        files: Sequence[McapFile],
        topic_name: Callable[[McapFile, Channel], str | None],
        topics: Sequence[str],
    ) -> None:
        """
        Args:
            files: the indexed files of the bag.
            topic_name: returns the current name of the topic of a channel; None if it is not read.
            topics: names of the topics.

        Raises:
            BagReadError: a chunk is damaged.
        """
        self.topics = tuple(topics)
        self._files = files
        self._streams: list[IO[bytes]] = [file.path.open("rb") for file in files]
        self._cache: OrderedDict[int, bytes] = OrderedDict()  # chunks by segment
        self._cache_size = 0
        self._segments = sorted(segment for file in files for segment in file.segments)
        numbers = {topic: number for number, topic in enumerate(self.topics)}
        by_channel = [
            {
                each.id: numbers[name]
                for each in file.channels.values()
                if (name := topic_name(file, each)) in numbers
            }
            for file in files
        ]
        delta_channels = [
            {each.id for each in file.channels.values() if has_deltas(file, each)} for file in files
        ]
        try:
            self._add_messages(by_channel, delta_channels)
        except BaseException:
            self.close()
            raise
        self._by_topic = [
            np.flatnonzero(self.topic_numbers == number) for number in range(len(self.topics))
        ]

    def _add_messages(
        self, by_channel: Sequence[Mapping[int, int]], delta_channels: Sequence[Set[int]]
    ) -> None:
        """Find all messages.

        Args:
            by_channel: number of the topic of each channel that is read, by file.
            delta_channels: channels that have maps as deltas, by file.
        """
        times, offsets, topic_numbers, segments, are_deltas = [], [], [], [], []
        for number, segment in enumerate(self._segments):
            for channel, entries in self._entries(number, segment):
                topic = by_channel[segment.file].get(channel)
                if topic is not None:
                    times.append(entries["time"].astype(np.int64))
                    offsets.append(entries["offset"].astype(np.int64))
                    topic_numbers.append(np.full(entries.size, topic))
                    segments.append(np.full(entries.size, number))
                    is_delta = channel in delta_channels[segment.file]
                    are_deltas.append(np.full(entries.size, is_delta))
        empty = np.zeros(0, dtype=np.int64)
        all_times = np.concatenate([empty, *times])
        all_offsets = np.concatenate([empty, *offsets])
        all_segments = np.concatenate([empty, *segments])
        order = np.lexsort((all_offsets, all_segments, all_times))
        self.times: NDArray[np.int64] = all_times[order]
        self.topic_numbers = np.concatenate([empty, *topic_numbers])[order]
        self._offsets, self._segment_numbers = all_offsets[order], all_segments[order]
        self._is_delta = np.concatenate([np.zeros(0, dtype=bool), *are_deltas])[order]

    @property
    def size(self) -> int:
        """Number of messages."""
        return int(self.times.size)

    def of_topic(self, topic: str) -> NDArray[np.intp]:
        """Return the numbers of the messages of a topic, ascending; empty for an unknown topic."""
        if topic not in self.topics:
            return np.zeros(0, dtype=np.intp)
        return self._by_topic[self.topics.index(topic)]

    def latest(self, topic: str, end: int) -> int | None:
        """Return the last message of a topic among those before number `end`; None without one."""
        numbers = self.of_topic(topic)
        position = int(np.searchsorted(numbers, end))
        return int(numbers[position - 1]) if position else None

    def read(self, number: int) -> bytes:
        """Return the CDR bytes of a message; of a map recorded as a delta, those of the map.

        Raises:
            BagReadError: its chunk is damaged, or the keyframe of a delta is missing.
        """
        data = self._read_recorded(number)
        if not self._is_delta[number]:
            return data
        maps = self._by_topic[self.topic_numbers[number]]
        keyframes = maps[(maps < number) & ~self._is_delta[maps]]
        for keyframe in keyframes[: -_MAX_KEYFRAMES - 1 : -1]:
            restored = apply_delta(self._read_recorded(int(keyframe)), data)
            if restored is not None:
                return restored
        topic = self.topics[self.topic_numbers[number]]
        raise BagReadError(
            f"a map on {topic}, log time {self.times[number]} ns, is recorded as a difference from"
            " another, which the bag lacks"
        )

    def _read_recorded(self, number: int) -> bytes:
        """Return the CDR bytes of a message as recorded."""
        segment_number = int(self._segment_numbers[number])
        data = self._segment_data(segment_number)
        offset = int(self._offsets[number])
        try:
            opcode, length = RECORD_HEADER.unpack_from(data, offset)
            if opcode != Opcode.MESSAGE:
                raise ValueError(f"its index names a record of kind {opcode} as a message")
            begin = offset + RECORD_HEADER.size
            return decompress_message(data[begin + MESSAGE_HEADER.size : begin + length])
        except (struct.error, ValueError, zstandard.ZstdError) as error:
            raise self._damage(segment_number, error) from error

    def close(self) -> None:
        """Close the files."""
        for stream in self._streams:
            stream.close()

    def _entries(self, number: int, segment: FileSegment) -> list[tuple[int, NDArray[np.void]]]:
        """Return channel and entries of the messages of a segment."""
        try:
            return list(self._read_entries(number, segment))
        except (struct.error, ValueError) as error:
            raise self._damage(number, error) from error

    def _read_entries(
        self, number: int, segment: FileSegment
    ) -> Iterator[tuple[int, NDArray[np.void]]]:
        stream = self._streams[segment.file]
        position = segment.offset + segment.length
        found = False
        while segment.is_chunk:
            stream.seek(position)
            header = stream.read(RECORD_HEADER.size)
            if len(header) < RECORD_HEADER.size:
                break
            opcode, length = RECORD_HEADER.unpack(header)
            if opcode != Opcode.MESSAGE_INDEX:
                break
            content = stream.read(length)
            channel, size = _INDEX_HEADER.unpack_from(content)
            if len(content) < length or size % _ENTRY.itemsize:
                break
            found = True
            position += RECORD_HEADER.size + length
            yield channel, np.frombuffer(content, _ENTRY, size // _ENTRY.itemsize, 6)
        if not found:
            yield from _scan(self._segment_data(number))

    def _damage(self, number: int, error: Exception) -> BagReadError:
        """Return the error for a damaged segment."""
        segment = self._segments[number]
        return damage(self._files[segment.file].path, segment.offset, error)

    def _segment_data(self, number: int) -> bytes:
        """Return the records of a segment, decompressed."""
        if number in self._cache:
            self._cache.move_to_end(number)
            return self._cache[number]
        segment = self._segments[number]
        stream = self._streams[segment.file]
        stream.seek(segment.offset)
        data = stream.read(segment.length)
        if segment.is_chunk:
            data = _decompress(data, segment, self._files[segment.file].path)
        else:
            data = RECORD_HEADER.pack(Opcode.MESSAGE, len(data)) + data
        self._cache[number] = data
        self._cache_size += len(data)
        while self._cache_size > _MAX_CACHE_SIZE and len(self._cache) > 1:
            self._cache_size -= len(self._cache.popitem(last=False)[1])
        return data


def _decompress(data: bytes, segment: FileSegment, path: Path) -> bytes:
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(data)))
        stream, length = get_chunk_data_stream(chunk, validate_crc=True)
        return stream.read(length)
    except Exception as error:
        raise damage(path, segment.offset, error) from error


def _scan(data: bytes) -> Iterator[tuple[int, NDArray[np.void]]]:
    """Yield channel and entry of each message in the records of a chunk."""
    for opcode, begin, _ in records_in(data):
        if opcode == Opcode.MESSAGE:
            channel, _, time, _ = MESSAGE_HEADER.unpack_from(data, begin)
            yield channel, np.array([(time, begin - RECORD_HEADER.size)], dtype=_ENTRY)
