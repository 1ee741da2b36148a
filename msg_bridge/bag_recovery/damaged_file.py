"""Find the records of an MCAP file, also behind damaged ones.

Records follow one another by their lengths. Where one makes no sense, the next chunk is searched:
the lengths in its header agree with one another, which other bytes do practically never.
Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream

from msg_bridge.bag.mcap_records import MAGIC, RECORD_HEADER

__all__ = ["FoundRecord", "Gap", "find_records"]

_CHUNK_HEADER = struct.Struct("<QQQII")  # times, uncompressed size, checksum, length of the name
_SIZE = struct.Struct("<Q")
_MAX_HEADER = RECORD_HEADER.size + _CHUNK_HEADER.size + _SIZE.size + 4
"""Size of the header of a chunk, the longest one [bytes]: a shorter rest may be part of one."""
_COMPRESSIONS = (b"", b"lz4", b"zstd")
_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_CHUNK = bytes([Opcode.CHUNK])


@dataclass(frozen=True)
class FoundRecord:
    """A record.

    Attributes:
        opcode: its kind.
        offset, length: position of its content in the file [bytes].
        is_cut_off: whether the file ends within it.
    """

    opcode: int
    offset: int
    length: int
    is_cut_off: bool = False


@dataclass(frozen=True)
class Gap:
    """Bytes that are no records.

    Attributes:
        offset, length: their position in the file [bytes].
        is_unwritten: whether it is a record of which the end was never written.
    """

    offset: int
    length: int
    is_unwritten: bool = False


def find_records(data: mmap.mmap) -> Iterator[FoundRecord | Gap]:
    """Yield the records of a file in their order, and the gaps between them, up to its footer.

    Args:
        data: the content of the file.
    """
    size = len(data)
    position = len(MAGIC) if data[: len(MAGIC)] == MAGIC else 0
    last: FoundRecord | None = None
    while position < size:
        record = _record_at(data, position)
        if record is not None and not record.is_cut_off:
            yield record
            if record.opcode == Opcode.FOOTER:
                return
            last, position = record, record.offset + record.length
            continue
        # The length of the last record may be wrong, too.
        is_sound = last is None or (last.opcode == Opcode.CHUNK and _is_sound_chunk(data, last))
        found = _next_chunk(data, position if last is None or is_sound else last.offset)
        if found is None:
            if record is not None and record.opcode == Opcode.CHUNK:
                yield record
            else:
                yield Gap(position, size - position, is_unwritten=_is_unwritten(data, position))
            return
        if found > position:
            yield Gap(position, found - position)
        last, position = None, found


def _is_unwritten(data: mmap.mmap, position: int) -> bool:
    """Return whether a file without a complete record at a position was cut off, not damaged.

    Then it ends within a record or its header, or with zeros.
    """
    record = _record_at(data, position)
    is_header = len(data) - position < _MAX_HEADER
    return record is not None or is_header or not data[position:].strip(b"\0")


def _is_sound_chunk(data: mmap.mmap, record: FoundRecord) -> bool:
    """Return whether a chunk can be decompressed and has its checksum."""
    try:
        content = data[record.offset : record.offset + record.length]
        get_chunk_data_stream(Chunk.read(ReadDataStream(BytesIO(content))), validate_crc=True)
    except Exception:  # of zstd, lz4, struct or mcap, depending on the damage
        return False
    return True


def _record_at(data: mmap.mmap, position: int) -> FoundRecord | None:
    """Return the record at a position; None if there is none."""
    size = len(data)
    if position + RECORD_HEADER.size > size:
        return None
    opcode, length = RECORD_HEADER.unpack_from(data, position)
    offset = position + RECORD_HEADER.size
    if opcode not in _OPCODES or (opcode == Opcode.CHUNK and not _is_chunk(data, position)):
        return None
    if offset + length > size:
        return FoundRecord(opcode, offset, size - offset, is_cut_off=True)
    return FoundRecord(opcode, offset, length)


def _is_chunk(data: mmap.mmap, position: int) -> bool:
    """Return whether the header of a chunk is at a position, by the lengths that it contains."""
    begin = position + RECORD_HEADER.size
    names = begin + _CHUNK_HEADER.size
    if names + max(map(len, _COMPRESSIONS)) + _SIZE.size > len(data):
        return False
    length = RECORD_HEADER.unpack_from(data, position)[1]
    start, end, _, _, name_length = _CHUNK_HEADER.unpack_from(data, begin)
    if name_length > max(map(len, _COMPRESSIONS)):
        return False
    name = data[names : names + name_length]
    (num_bytes,) = _SIZE.unpack_from(data, names + name_length)
    header_length = _CHUNK_HEADER.size + name_length + _SIZE.size
    return name in _COMPRESSIONS and start <= end and length == header_length + num_bytes


def _next_chunk(data: mmap.mmap, position: int) -> int | None:
    """Return the position of the next complete chunk; None if there is none."""
    while (position := data.find(_CHUNK, position)) >= 0:
        if _is_chunk(data, position):
            record = _record_at(data, position)
            if record is not None and not record.is_cut_off:
                return position
        position += 1
    return None
