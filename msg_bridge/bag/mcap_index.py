"""Find the chunks, messages and attachments of an MCAP file without decompressing it.

The file is scanned record by record, so that one without a summary (its recorder was killed) is
indexed like a finished one. Only where the summary is missing are the chunks decompressed, to count
their messages. Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Container
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import breakup_chunk, get_chunk_data_stream

from msg_bridge.bag.compressed_message import decompress_message
from msg_bridge.bag.damage_text import describe_damage
from msg_bridge.bag.mcap_records import (
    CHECKSUM,
    CHUNK_TIMES,
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    ZSTD_MAGIC,
    records_in,
)
from msg_bridge.contract.errors import EarthmovingError

__all__ = [
    "AttachmentPlace",
    "BagReadError",
    "FileSegment",
    "McapFile",
    "RecordedMessage",
    "damage",
    "index_file",
    "parse_attachment",
    "read_attachment",
    "read_messages",
    "read_records",
]

_ATTACHMENT_HEADER = struct.Struct("<QQI")  # log time, time of creation, length of the name


class BagReadError(EarthmovingError):
    """A bag cannot be read, or lacks what is requested."""


@dataclass(frozen=True, order=True)
class FileSegment:
    """A chunk, or a message outside of chunks; segments sort by time, then by position.

    Attributes:
        start_ns: log time of its first message [ns].
        file: index of the file in its bag.
        offset, length: position of its content in the file [bytes].
        is_chunk: whether it is a chunk.
    """

    start_ns: int
    file: int
    offset: int
    length: int
    is_chunk: bool


class AttachmentPlace(NamedTuple):
    """Position of an attachment.

    Attributes:
        offset, length: position of its record's content in the file [bytes].
    """

    offset: int
    length: int


@dataclass
class McapFile:
    """Index of one MCAP file.

    Attributes:
        path: the file.
        is_complete: whether it has its footer.
        segments: its chunks and messages outside of chunks.
        schemas, channels: by id.
        counts: number of messages by channel id.
        attachments: positions by name; the last one of several with the same name.
    """

    path: Path
    is_complete: bool = False
    segments: list[FileSegment] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    attachments: dict[str, AttachmentPlace] = field(default_factory=dict)


def index_file(number: int, path: Path) -> McapFile:
    """Index a file.

    Args:
        number: index of the file in its bag.
        path: the file.

    Raises:
        BagReadError: it is empty, not MCAP or damaged, or cannot be opened.
    """
    file = McapFile(path)
    try:
        with path.open("rb") as stream:
            if not path.stat().st_size:
                raise BagReadError(f"{path} is empty")
            begin = stream.read(len(MAGIC))
            if begin.startswith(ZSTD_MAGIC):
                raise BagReadError(
                    f"{path} is compressed as a whole; make a bag that can be read of it by"
                    " `earthmoving recover`"
                )
            if begin != MAGIC:
                raise BagReadError(f"{path} is not an MCAP file; give an .mcap file, or a folder")
            _index_records(file, number, stream)
    except OSError as error:
        raise BagReadError(f"{path} cannot be read: {error.strerror or error}") from error
    return file


def damage(path: Path, offset: int, error: Exception) -> BagReadError:
    """Return the error for a damaged file.

    Args:
        path: the file.
        offset: where [bytes].
        error: of zstd, lz4, struct, numpy or mcap, depending on the damage.
    """
    if isinstance(error, BagReadError):
        return error
    return BagReadError(
        f"{path} is damaged at byte {offset}, in the record there: {describe_damage(error)};"
        " `earthmoving recover` saves the rest"
    )


def _index_records(file: McapFile, number: int, stream: IO[bytes]) -> None:
    """Add all segments, schemas and channels, and count the messages."""
    try:
        statistics = _scan_records(file, number, stream)
    except Exception as error:
        raise damage(file.path, stream.tell(), error) from error
    counts = None if statistics is None else statistics.channel_message_counts
    if file.is_complete and counts and set(counts) <= set(file.channels):
        file.counts.update(counts)
    else:
        _count_messages(file, stream)


def _scan_records(file: McapFile, number: int, stream: IO[bytes]) -> Statistics | None:
    """Add all segments, schemas and channels outside of chunks; return the statistics if any."""
    size = file.path.stat().st_size
    statistics: Statistics | None = None
    while True:
        header = stream.read(RECORD_HEADER.size)
        if len(header) < RECORD_HEADER.size:
            break
        opcode, length = RECORD_HEADER.unpack(header)
        begin = stream.tell()
        end = begin + length
        if end > size or opcode == 0:  # a system crash leaves zeros at the end of a file
            break
        if opcode == Opcode.CHUNK:
            start, _ = CHUNK_TIMES.unpack(stream.read(CHUNK_TIMES.size))
            file.segments.append(FileSegment(start, number, begin, length, is_chunk=True))
        elif opcode == Opcode.MESSAGE:
            _, _, start, _ = MESSAGE_HEADER.unpack(stream.read(MESSAGE_HEADER.size))
            file.segments.append(FileSegment(start, number, begin, length, is_chunk=False))
        elif opcode == Opcode.ATTACHMENT:
            name = _attachment_name(stream)
            file.attachments[name] = AttachmentPlace(begin, length)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            _add_record(file, _parse(opcode, stream.read(length)))
        elif opcode == Opcode.STATISTICS:
            statistics = Statistics.read(ReadDataStream(BytesIO(stream.read(length))))
        elif opcode == Opcode.FOOTER:
            file.is_complete = True
            break
        stream.seek(end)
    return statistics


def _attachment_name(stream: IO[bytes]) -> str:
    """Return the name of the attachment whose content begins here, without reading its data."""
    _, _, length = _ATTACHMENT_HEADER.unpack(stream.read(_ATTACHMENT_HEADER.size))
    return stream.read(length).decode()


def read_attachment(file: McapFile, name: str) -> bytes:
    """Return the data of an attachment of a file.

    Raises:
        BagReadError: it is damaged, or the file cannot be read.
    """
    place = file.attachments[name]
    try:
        with file.path.open("rb") as stream:
            stream.seek(place.offset)
            content = stream.read(place.length)
        return bytes(parse_attachment(content).data)
    except Exception as error:
        raise damage(file.path, place.offset, error) from error


def parse_attachment(content: bytes) -> Attachment:
    """Return the attachment in the content of a record.

    Raises:
        ValueError: its checksum is wrong; or other errors, depending on the damage.
    """
    attachment: Attachment = Attachment.read(ReadDataStream(BytesIO(content)))
    # The checksum is over all of the content before it; 0: there is none.
    (checksum,) = CHECKSUM.unpack(content[-CHECKSUM.size :])
    if checksum and checksum != zlib.crc32(content[: -CHECKSUM.size]):
        raise ValueError("its checksum is wrong")
    return attachment


def _count_messages(file: McapFile, stream: IO[bytes]) -> None:
    """Decompress all chunks to find their channels and count their messages."""
    if file.segments and not file.is_complete:
        try:
            read_records(file, stream, file.segments[-1])
        except BagReadError:  # the file ends within its last chunk
            del file.segments[-1]
    for segment in file.segments:
        for record in read_records(file, stream, segment):
            _add_record(file, record)


def _add_record(file: McapFile, record: McapRecord) -> None:
    if isinstance(record, Schema):
        file.schemas[record.id] = record
    elif isinstance(record, Channel):
        file.channels[record.id] = record
    elif isinstance(record, Message):
        file.counts[record.channel_id] += 1


def read_records(file: McapFile, stream: IO[bytes], segment: FileSegment) -> list[McapRecord]:
    """Return the records of a segment of a file.

    Raises:
        BagReadError: the segment is damaged.
    """
    stream.seek(segment.offset)
    data = stream.read(segment.length)
    try:
        if not segment.is_chunk:
            return [_parse(Opcode.MESSAGE, data)]
        return breakup_chunk(Chunk.read(ReadDataStream(BytesIO(data))), validate_crc=True)
    except Exception as error:
        raise damage(file.path, segment.offset, error) from error


class RecordedMessage(NamedTuple):
    """A message as it was recorded: channel id, log time [ns] and bytes, decompressed."""

    channel: int
    log_time: int
    data: bytes


def read_messages(
    file: McapFile, stream: IO[bytes], segment: FileSegment, channels: Container[int]
) -> list[RecordedMessage]:
    """Return the messages of some channels in a segment of a file; others are not parsed.

    Raises:
        BagReadError: the segment is damaged.
    """
    stream.seek(segment.offset)
    content = stream.read(segment.length)
    try:
        if segment.is_chunk:
            chunk = Chunk.read(ReadDataStream(BytesIO(content)))
            records, length = get_chunk_data_stream(chunk, validate_crc=True)
            return _messages_in(records.read(length), channels)
        return _messages_in(RECORD_HEADER.pack(Opcode.MESSAGE, len(content)) + content, channels)
    except Exception as error:
        raise damage(file.path, segment.offset, error) from error


def _messages_in(data: bytes, channels: Container[int]) -> list[RecordedMessage]:
    """Return the messages of some channels in the records of a chunk.

    Raises:
        ValueError: the records are cut short; or struct.error, or zstandard.ZstdError.
    """
    found, end = [], 0
    for opcode, begin, end in records_in(data):
        if opcode == Opcode.MESSAGE:
            channel, _, log_time, _ = MESSAGE_HEADER.unpack_from(data, begin)
            if channel in channels:
                content = decompress_message(data[begin + MESSAGE_HEADER.size : end])
                found.append(RecordedMessage(channel, log_time, content))
    if end < len(data):
        raise ValueError("its last record is cut short")
    return found


_PARSERS: dict[int, Callable[[ReadDataStream, int], McapRecord]] = {
    Opcode.SCHEMA: lambda stream, length: Schema.read(stream),
    Opcode.CHANNEL: lambda stream, length: Channel.read(stream),
    Opcode.MESSAGE: Message.read,
}


def _parse(opcode: int, data: bytes) -> McapRecord:
    return _PARSERS[opcode](ReadDataStream(BytesIO(data)), len(data))
