"""Layout of the records of an MCAP file. Format: https://mcap.dev/spec."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

__all__ = [
    "CHECKSUM",
    "CHUNK_TIMES",
    "MAGIC",
    "MESSAGE_HEADER",
    "RECORD_HEADER",
    "ZSTD_MAGIC",
    "Record",
    "records_in",
]

MAGIC: Final = b"\x89MCAP0\r\n"
"""First and last bytes of a file."""

ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
"""First bytes of a file that is compressed as a whole by zstd."""

RECORD_HEADER: Final = struct.Struct("<BQ")
"""Opcode, and length of the content."""

MESSAGE_HEADER: Final = struct.Struct("<HIQQ")
"""Begin of a message's content: channel, sequence number, log time and publish time [ns]."""

CHUNK_TIMES: Final = struct.Struct("<QQ")
"""Begin of a chunk's content: log times of its first and last message [ns]."""

CHECKSUM: Final = struct.Struct("<I")


class Record(NamedTuple):
    """A record in the data of a chunk: its opcode, and begin and end of its content."""

    opcode: int
    begin: int
    end: int


def records_in(data: bytes) -> Iterator[Record]:
    """Yield the records in the data of a chunk, up to one that is cut short."""
    position = 0
    while position + RECORD_HEADER.size <= len(data):
        opcode, length = RECORD_HEADER.unpack_from(data, position)
        begin = position + RECORD_HEADER.size
        position = begin + length
        if position > len(data):
            return
        yield Record(opcode, begin, position)
