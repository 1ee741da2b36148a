"""Messages that were compressed one by one, as by `ros2 bag record --compression-mode message`."""

from __future__ import annotations

import zstandard

from msg_bridge.bag.mcap_records import ZSTD_MAGIC

__all__ = ["decompress_message", "is_compressed_message"]


def is_compressed_message(data: bytes) -> bool:
    """Return whether the data of a message are compressed; those of CDR begin with a zero."""
    return data.startswith(ZSTD_MAGIC)


def decompress_message(data: bytes) -> bytes:
    """Return the data of a message, decompressed if they are compressed.

    Raises:
        zstandard.ZstdError: they are damaged, or end before their frame does.
    """
    if not is_compressed_message(data):
        return data
    frame = zstandard.ZstdDecompressor().decompressobj()
    content: bytes = frame.decompress(data)
    if not frame.eof:
        raise zstandard.ZstdError("the frame has no end")
    return content
