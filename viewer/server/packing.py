"""msgpack maps put together from parts that are packed already.

Parts that all clients get are packed once and copied into the message of each client.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import msgpack

__all__ = ["pack", "pack_map"]


def pack(value: Any) -> bytes:
    """Return a value of plain types as msgpack; floats as float64, bytes as bin."""
    packed: bytes = msgpack.packb(value, use_bin_type=True)
    return packed


def pack_map(parts: Mapping[str, bytes]) -> bytes:
    """Return a msgpack map with string keys and values that are packed already."""
    count = len(parts)
    header = bytes([0x80 | count]) if count < 16 else struct.pack(">BH", 0xDE, count)
    items = (part for key, value in parts.items() for part in (pack(key), value))
    return b"".join([header, *items])
