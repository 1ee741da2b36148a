"""Primitives of little-endian CDR, as ROS 2 serialises messages.

Four header bytes precede the content. A uint32 lies at a multiple of 4 bytes; a string is its
length with the final zero as uint32, its bytes, and padding up to where the next value may lie.
"""

from __future__ import annotations

import struct

__all__ = [
    "LITTLE_ENDIAN",
    "STAMP",
    "UINT32",
    "is_little_endian",
    "pack_string",
    "read_string",
    "string_end",
]

LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""Header of a message in little-endian byte order."""

UINT32 = struct.Struct("<I")

STAMP = struct.Struct("<iI")
"""A builtin_interfaces/Time: seconds and nanoseconds."""


def is_little_endian(data: bytes) -> bool:
    """Return whether a message has the header of little-endian CDR; its options are ignored."""
    return data[:2] == LITTLE_ENDIAN[:2]


def pack_string(text: str) -> bytes:
    """Serialise a string that begins at a multiple of 4, padded to a multiple of 4 bytes."""
    content = text.encode() + b"\0"
    return UINT32.pack(len(content)) + content + b"\0" * (-len(content) % 4)


def read_string(data: bytes, offset: int) -> tuple[str, int]:
    """Return the string at an offset, and the next multiple of 4 after it.

    Raises:
        struct.error: the message ends before the string.
        UnicodeDecodeError: it is not UTF-8.
    """
    (size,) = UINT32.unpack_from(data, offset)
    return data[offset + 4 : offset + 3 + size].decode(), string_end(data, offset)


def string_end(data: bytes, offset: int) -> int:
    """Return the next multiple of 4 after the string at an offset.

    Raises:
        struct.error: the message ends before the string.
    """
    size: int = UINT32.unpack_from(data, offset)[0]
    return offset + 4 + size + -size % 4
