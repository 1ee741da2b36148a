"""Rows cut into messages of bounded size."""

from __future__ import annotations

from msg_bridge.contract.messages import RowChunk, Stream
from msg_bridge.contract.rows import Rows

__all__ = ["CHUNK_ROWS", "chunked"]

CHUNK_ROWS = 2048
"""Rows in one message, at most: a lost one is then cheap to send again."""


def chunked(
    epoch: int, stream: Stream, rows: Rows, *, source: int = 0, life: int = 0
) -> list[RowChunk]:
    """Chunks of at most CHUNK_ROWS rows; none for no rows."""
    return [
        RowChunk(epoch, stream, source, life, rows[first : first + CHUNK_ROWS])
        for first in range(0, rows.size, CHUNK_ROWS)
    ]
