"""Write one MCAP file: chunks of messages with their index, attachments, and a summary.

The writer of the library `mcap` gives offsets of groups that are empty, and it leaves a channel
that was added after the last message out of the data section: validators report both as errors.
Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from msg_bridge.bag.mcap_records import MAGIC

__all__ = ["COMPRESSORS", "ByteStream", "McapFileWriter"]

COMPRESSORS: Mapping[str, Callable[[bytes], bytes]] = {
    "zstd": zstandard.compress,
    "lz4": lz4.frame.compress,
    "": bytes,
}
"""Compression of a chunk, by its name in the file."""

_FOOTER_START = struct.Struct("<BQQQ")  # of the footer, what its checksum covers
_FOOTER_LENGTH = 20


class ByteStream(Protocol):
    """The file that is written."""

    def write(self, data: bytes, /) -> int: ...

    def tell(self) -> int: ...


class McapFileWriter:
    """An MCAP file being written.

    A chunk and the index of its messages are one call of `write`. Schemas and channels are part of
    the chunk that follows, so they precede their messages.
    """

    def __init__(
        self, stream: ByteStream, *, profile: str, library: str, compression: str, chunk_size: int
    ) -> None:
        """Write the header.

        Args:
            stream: an empty file.
            profile, library: values of the header.
            compression: of chunks, one of COMPRESSORS.
            chunk_size: size from which on a chunk is written [bytes], before compression.
        """
        self._stream = stream
        self._compression = compression
        self._chunk_size = chunk_size
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._counts: Counter[int] = Counter()
        self._chunk_indices: list[ChunkIndex] = []
        self._attachment_indices: list[AttachmentIndex] = []
        self._start_chunk()
        self._write(MAGIC + _to_bytes([Header(profile, library)]))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema and return its id."""
        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        schema.write(self._chunk)
        return schema.id

    def add_channel(
        self, topic: str, schema: int, metadata: Mapping[str, str], encoding: str = "cdr"
    ) -> int:
        """Add a channel and return its id.

        Args:
            topic: name of its topic.
            schema: id of the schema of its messages; 0 without one.
            metadata: values by name.
            encoding: of its messages.
        """
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata),
            schema_id=schema,
        )
        self._channels.append(channel)
        channel.write(self._chunk)
        return channel.id

    def add_message(self, message: Message) -> None:
        """Add a message of a known channel."""
        index = self._message_indices.setdefault(
            message.channel_id, MessageIndex(message.channel_id, [])
        )
        index.records.append((message.log_time, self._chunk.count))
        message.write(self._chunk)
        self._counts[message.channel_id] += 1
        if self._chunk.count > self._chunk_size:
            self.write_chunk()

    def write_chunk(self) -> None:
        """Write the current chunk if it has messages."""
        if not self._message_indices:
            return
        indices, data = self._message_indices.values(), _content(self._chunk)
        self._start_chunk()
        times = [time for index in indices for time, _ in index.records]
        compressed = COMPRESSORS[self._compression](data)
        chunk = Chunk(
            compression=self._compression,
            data=compressed,
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        builder, start = RecordBuilder(), self._stream.tell()
        chunk.write(builder)
        chunk_length = builder.count
        offsets = {}
        for index in indices:
            offsets[index.channel_id] = start + builder.count
            index.write(builder)
        self._chunk_indices.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=start,
                chunk_length=chunk_length,
                message_index_offsets=offsets,
                message_index_length=builder.count - chunk_length,
                compression=self._compression,
                compressed_size=len(compressed),
                uncompressed_size=len(data),
            )
        )
        self._write(_content(builder))

    def add_attachment(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """Write a file into the MCAP file.

        Args:
            name: its name in the MCAP file.
            media_type: such as `application/yaml`.
            data: its content.
            time: log time and time of creation [ns].
        """
        attachment = Attachment(
            create_time=time, data=data, log_time=time, media_type=media_type, name=name
        )
        builder, offset = RecordBuilder(), self._stream.tell()
        attachment.write(builder)
        length = builder.count
        self._write(_content(builder))
        self._attachment_indices.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                log_time=time,
                create_time=time,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def finish(self) -> None:
        """Write the current chunk, the summary and the footer."""
        self.write_chunk()
        # Schemas and channels that were added after the last message.
        self._write(_content(self._chunk) + _to_bytes([DataEnd(0)]))
        start = self._stream.tell()
        summary, offsets = RecordBuilder(), RecordBuilder()
        groups: list[tuple[Opcode, Iterable[McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunk_indices),
            (Opcode.ATTACHMENT_INDEX, self._attachment_indices),
        ]
        for opcode, records in groups:
            position = summary.count
            for each in records:
                each.write(summary)
            if summary.count > position:
                SummaryOffset(opcode, start + position, summary.count - position).write(offsets)
        offset_start = start + summary.count
        data = _content(summary) + _content(offsets)
        covered = _FOOTER_START.pack(Opcode.FOOTER, _FOOTER_LENGTH, start, offset_start)
        footer = Footer(start, offset_start, zlib.crc32(data + covered))
        self._write(data + _to_bytes([footer]) + MAGIC)

    def _start_chunk(self) -> None:
        self._chunk = RecordBuilder()
        self._message_indices: dict[int, MessageIndex] = {}

    def _write(self, data: bytes) -> None:
        self._stream.write(data)

    def _statistics(self) -> Statistics:
        chunks = self._chunk_indices
        return Statistics(
            attachment_count=len(self._attachment_indices),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(chunks),
            message_count=self._counts.total(),
            message_start_time=min((each.message_start_time for each in chunks), default=0),
            message_end_time=max((each.message_end_time for each in chunks), default=0),
            metadata_count=0,
            schema_count=len(self._schemas),
        )


def _to_bytes(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for each in records:
        each.write(builder)
    return _content(builder)


def _content(builder: RecordBuilder) -> bytes:
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
