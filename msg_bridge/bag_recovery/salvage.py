"""What can be read of an MCAP file that may be cut off or damaged."""

from __future__ import annotations

import contextlib
import mmap
import os
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Message, MessageIndex, Schema
from mcap.stream_reader import get_chunk_data_stream

from msg_bridge.bag.damage_text import describe_damage
from msg_bridge.bag.mcap_index import BagReadError, parse_attachment
from msg_bridge.bag.mcap_records import (
    CHECKSUM,
    CHUNK_TIMES,
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    records_in,
)
from msg_bridge.bag_recovery.compressed_file import Decompressed, decompress, is_compressed
from msg_bridge.bag_recovery.damaged_file import FoundRecord, Gap, find_records

__all__ = ["Damage", "SalvagedFile"]

_NAMES: dict[int, str] = {Opcode.MESSAGE_INDEX: "index of messages", Opcode.FOOTER: "summary"}
_CONSEQUENCES = {True: "its content is lost", False: "it is made again, and nothing is lost"}
"""What follows from a damage, by whether it is a loss."""

_PARSERS: dict[int, Callable[[ReadDataStream, int], Schema | Channel | Message]] = {
    Opcode.SCHEMA: lambda stream, length: Schema.read(stream),
    Opcode.CHANNEL: lambda stream, length: Channel.read(stream),
    Opcode.MESSAGE: Message.read,
}

_ZEROS = 64
"""Number of zeros at the end of a chunk by which its end was not written."""

_PIECE = 1024
"""Size of the pieces in which an incomplete chunk is decompressed [bytes]."""

_DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    "zstd": lambda: zstandard.ZstdDecompressor().decompressobj(),
    "lz4": lz4.frame.LZ4FrameDecompressor,
}

Content = Schema | Channel | Message | Attachment
"""Records that are salvaged."""


@dataclass(frozen=True)
class Damage:
    """A part of a file that cannot be read.

    Attributes:
        offset, length: its position in the file [bytes].
        text: what is wrong.
        start, end: log times of its first and last message [ns], if it is a chunk.
        is_loss: whether messages or files are lost; false for an index, which is made again, and
            for a record in which the file ends.
    """

    offset: int
    length: int
    text: str
    start: int | None = None
    end: int | None = None
    is_loss: bool = True


@dataclass
class SalvagedFile:
    """A file that is read as far as possible.

    Attributes:
        path: the file.
        scratch: folder for a temporary file, the content of a file that is compressed as a whole.
        is_compressed: whether it is one; bytes are counted in its content then.
        damages: parts that could not be read, after `records` has ended.
        is_complete: whether the file has its end.
        num_cut_off: number of messages from a chunk in which the file ends. It has no checksum.
    """

    path: Path
    scratch: Path
    is_compressed: bool = False
    damages: list[Damage] = field(default_factory=list)
    is_complete: bool = False
    num_cut_off: int = 0
    _chunk_data: bytes = b""  # of the last chunk, for its index

    def records(self) -> Iterator[tuple[Content, float]]:
        """Yield schemas, channels, messages and attachments, and the fraction read of the file.

        Schemas and channels of the summary follow last, so those of a damaged chunk are not lost.

        Raises:
            BagReadError: the file is empty, no MCAP file, or cannot be opened.
        """
        try:
            with self.path.open("rb") as stream:
                if not self.path.stat().st_size:
                    raise BagReadError(f"{self.path} is empty")
                self.is_compressed = is_compressed(stream)
                if self.is_compressed:
                    with decompress(stream, self.scratch) as content:
                        yield from self._read_compressed(content)
                    return
                with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                    yield from self._read(data)
        except OSError as error:
            raise BagReadError(f"{self.path} cannot be read: {error.strerror or error}") from error

    def _read_compressed(self, content: Decompressed) -> Iterator[tuple[Content, float]]:
        if content.stream.seek(0, os.SEEK_END):
            with mmap.mmap(content.stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                yield from self._read(data)
        size = self.path.stat().st_size
        if content.is_damaged:
            text = "are damaged and cannot be decompressed from there on"
        elif content.is_cut_off:
            text = "end: their end was not written"
        else:
            return
        where = f"at byte {content.end:,} of {size:,} of the compressed file its data {text}"
        length = content.stream.seek(0, os.SEEK_END)
        self.damages.append(Damage(length, 0, where, is_loss=content.is_damaged))

    def _read(self, data: mmap.mmap) -> Iterator[tuple[Content, float]]:
        num_records, is_summary = 0, False
        for found in find_records(data):
            if isinstance(found, Gap):
                is_loss = not (found.is_unwritten or is_summary)
                if found.is_unwritten:
                    text = "its end was not written"
                elif is_summary:
                    text = f"damaged summary: {_CONSEQUENCES[is_loss]}"
                else:
                    text = "no records; skipped"
                self.damages.append(Damage(found.offset, found.length, text, is_loss=is_loss))
                continue
            num_records += 1
            is_summary |= found.opcode == Opcode.DATA_END
            self.is_complete |= found.opcode == Opcode.FOOTER
            fraction = (found.offset + found.length) / len(data)
            for record in self._contents(data, found):
                yield record, fraction
        if not num_records and data[: len(MAGIC)] != MAGIC:
            state = ", also not decompressed" if self.is_compressed else ""
            raise BagReadError(f"{self.path} is not an MCAP file{state}")

    def _contents(self, data: mmap.mmap, found: FoundRecord) -> Iterator[Content]:
        content = data[found.offset : found.offset + found.length]
        stream = ReadDataStream(BytesIO(content))
        try:
            if found.is_cut_off:
                yield from self._cut_off_chunk(content)
            elif found.opcode == Opcode.CHUNK:
                self._chunk_data = b""
                chunk = get_chunk_data_stream(Chunk.read(stream), validate_crc=True)
                self._chunk_data = chunk[0].read(chunk[1])
                yield from _parse_records(self._chunk_data)
            elif found.opcode in _PARSERS:
                yield _PARSERS[found.opcode](stream, len(content))
            elif found.opcode == Opcode.ATTACHMENT:
                yield parse_attachment(content)
            elif found.opcode == Opcode.MESSAGE_INDEX:
                _check_index(MessageIndex.read(stream), self._chunk_data)
            elif found.opcode == Opcode.FOOTER:
                _check_summary(Footer.read(stream), data, found)
        except Exception as error:  # of zstd, lz4, struct or mcap, depending on the damage
            if found.opcode == Opcode.CHUNK and _ends_with_zeros(data, found):
                yield from self._cut_off_chunk(content.rstrip(b"\0"))
                text = "its end was not written"
                self.damages.append(Damage(found.offset, found.length, text, is_loss=False))
            else:
                self._add_damage(found, content, error)

    def _cut_off_chunk(self, content: bytes) -> Iterator[Content]:
        """Yield the records at the begin of a chunk in which the file ends."""
        for record in _parse_records(_decompress_begin(content)):
            self.num_cut_off += isinstance(record, Message)
            yield record

    def _add_damage(self, found: FoundRecord, content: bytes, error: Exception) -> None:
        name = _NAMES.get(found.opcode, Opcode(found.opcode).name.lower())
        is_loss = found.opcode not in (Opcode.MESSAGE_INDEX, Opcode.FOOTER)
        start = end = None
        if found.opcode == Opcode.CHUNK and len(content) >= CHUNK_TIMES.size:
            start, end = CHUNK_TIMES.unpack_from(content)
        self.damages.append(
            Damage(
                found.offset,
                found.length,
                f"damaged {name}: {describe_damage(error)}; {_CONSEQUENCES[is_loss]}",
                start,
                end,
                is_loss=is_loss,
            )
        )


def _ends_with_zeros(data: mmap.mmap, found: FoundRecord) -> bool:
    """Return whether a record ends with zeros, and only zeros follow.

    A system crash leaves them where the file was made longer and not written.
    """
    return not data[found.offset + found.length - _ZEROS :].strip(b"\0")


def _decompress_begin(content: bytes) -> bytes:
    """Return the begin of the records of a chunk whose end is missing."""
    stream = ReadDataStream(BytesIO(content))
    stream.read(CHUNK_TIMES.size)
    stream.read8()  # uncompressed size
    stream.read4()  # checksum
    compression = stream.read_prefixed_string()
    stream.read8()  # size of what follows
    data = content[stream.count :]
    if compression not in _DECOMPRESSORS:
        return data
    decompressor = _DECOMPRESSORS[compression]()
    result = bytearray()
    with contextlib.suppress(zstandard.ZstdError, RuntimeError, EOFError):
        for begin in range(0, len(data), _PIECE):  # what precedes an error is returned
            result += decompressor.decompress(data[begin : begin + _PIECE])
    return bytes(result)


def _parse_records(data: bytes) -> Iterator[Schema | Channel | Message]:
    """Yield the complete records at the begin of a chunk's data."""
    for opcode, begin, end in records_in(data):
        if opcode not in _PARSERS:  # zeros, as a system crash leaves them
            return
        yield _PARSERS[opcode](ReadDataStream(BytesIO(data[begin:end])), end - begin)


def _check_index(index: MessageIndex, data: bytes) -> None:
    """Check the index of a channel's messages against the data of their chunk.

    Raises:
        ValueError: it names other messages; or struct.error.
    """
    for time, offset in index.records if data else ():
        opcode, _ = RECORD_HEADER.unpack_from(data, offset)
        channel, _, log_time, _ = MESSAGE_HEADER.unpack_from(data, offset + RECORD_HEADER.size)
        if (opcode, channel, log_time) != (Opcode.MESSAGE, index.channel_id, time):
            raise ValueError("its entries name other messages than the chunk has")


def _check_summary(footer: Footer, data: mmap.mmap, found: FoundRecord) -> None:
    """Check the checksum of the summary.

    Raises:
        ValueError: it is wrong.
    """
    end = found.offset + found.length - CHECKSUM.size  # all but the checksum itself is covered
    has_checksum = footer.summary_start and footer.summary_crc
    if has_checksum and zlib.crc32(data[footer.summary_start : end]) != footer.summary_crc:
        raise ValueError("its checksum is wrong")
