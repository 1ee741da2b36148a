"""Where the messages lie in an MCAP file, found without unpacking it.

Records are stepped over one by one, so that a file that was never finished is surveyed as one with
a summary is. Only where a summary is missing are its chunks unpacked, to count what is in them.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import breakup_chunk

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["BagReadError", "FileSegment", "McapFile", "index_file", "records"]

_MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_TIMES = struct.Struct("<QQ")  # how a chunk begins: log times of its first and last message
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time


class BagReadError(EarthmovingError):
    """A bag cannot be read, or has not what is asked for."""


@dataclass(frozen=True, order=True)
class FileSegment:
    """A chunk, or a message outside chunks; parts sort by time, then by place."""

    start_ns: int
    file: int
    offset: int
    length: int
    is_chunk: bool


@dataclass
class McapFile:
    """What is where in one MCAP file.

    Attributes:
        whole: whether it ends as a finished file does.
    """

    path: Path
    is_complete: bool = False
    segments: list[FileSegment] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)


def index_file(number: int, path: Path) -> McapFile:
    """What is where in a file, without unpacking it where it has a summary."""
    file = McapFile(path)
    size = path.stat().st_size
    statistics: Statistics | None = None
    with path.open("rb") as stream:
        magic = stream.read(len(_MAGIC))
        if not size:
            raise BagReadError(f"{path} is empty")
        if magic != _MAGIC:
            raise BagReadError(f"{path} is not an MCAP file; if it is compressed, unpack it first")
        while True:
            offset = stream.tell()
            head = stream.read(_RECORD.size)
            if len(head) < _RECORD.size:
                break
            opcode, length = _RECORD.unpack(head)
            begin, end = offset + len(head), offset + len(head) + length
            if end > size or opcode == 0:  # zeros are what a crash of the machine leaves
                break
            if opcode == Opcode.CHUNK:
                start, _ = _TIMES.unpack(stream.read(_TIMES.size))
                file.segments.append(FileSegment(start, number, begin, length, is_chunk=True))
            elif opcode == Opcode.MESSAGE:
                _, _, start, _ = _MESSAGE.unpack(stream.read(_MESSAGE.size))
                file.segments.append(FileSegment(start, number, begin, length, is_chunk=False))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                _add_record(file, _parse(opcode, stream.read(length)))
            elif opcode == Opcode.STATISTICS:
                statistics = Statistics.read(ReadDataStream(BytesIO(stream.read(length))))
            elif opcode == Opcode.FOOTER:
                file.is_complete = True
                break
            stream.seek(end)
        counts = None if statistics is None else statistics.channel_message_counts
        if file.is_complete and counts and set(counts) <= set(file.channels):
            file.counts.update(counts)
        else:
            _count_messages(file, stream)
    return file


def _count_messages(file: McapFile, stream: IO[bytes]) -> None:
    """Unpack everything to learn its channels and counts."""
    if file.segments and not file.is_complete:
        try:
            records(file, stream, file.segments[-1])
        except BagReadError:  # it breaks off within its last chunk
            del file.segments[-1]
    for part in file.segments:
        for record in records(file, stream, part):
            _add_record(file, record)


def _add_record(file: McapFile, record: McapRecord) -> None:
    if isinstance(record, Schema):
        file.schemas[record.id] = record
    elif isinstance(record, Channel):
        file.channels[record.id] = record
    elif isinstance(record, Message):
        file.counts[record.channel_id] += 1


def records(file: McapFile, stream: IO[bytes], part: FileSegment) -> list[McapRecord]:
    """The records of a part of a file."""
    stream.seek(part.offset)
    data = stream.read(part.length)
    try:
        if not part.is_chunk:
            return [_parse(Opcode.MESSAGE, data)]
        return breakup_chunk(Chunk.read(ReadDataStream(BytesIO(data))), validate_crc=True)
    except Exception as error:  # of zstd, lz4, struct, mcap: by kind of damage
        raise BagReadError(
            f"{file.path} is damaged at byte {part.offset}: {error}; `mcap recover` saves the rest"
        ) from error


_PARSERS: dict[int, Callable[[ReadDataStream, int], McapRecord]] = {
    Opcode.SCHEMA: lambda stream, length: Schema.read(stream),
    Opcode.CHANNEL: lambda stream, length: Channel.read(stream),
    Opcode.MESSAGE: Message.read,
}


def _parse(opcode: int, data: bytes) -> McapRecord:
    return _PARSERS[opcode](ReadDataStream(BytesIO(data)), len(data))
