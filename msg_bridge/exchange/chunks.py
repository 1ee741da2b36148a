"""Split rows into messages of bounded size."""

from __future__ import annotations

from msg_bridge.contract.messages import NumberedRows, RowChunk, Stream
from msg_bridge.contract.rows import Rows

__all__ = ["MAX_ROWS_PER_CHUNK", "sent_chunks", "split_into_chunks"]

MAX_ROWS_PER_CHUNK = 2048
"""Maximum number of rows in a message; small, so that a lost one is cheap to send again."""


def sent_chunks(
    run_id: int, stream: Stream, sent: NumberedRows, *, machine_id: int = 0, session_id: int = 0
) -> list[RowChunk]:
    """Return the chunks of rows that are sent for the first time; none if there are no rows."""
    rows = sent.rows
    if 0 < rows.size <= MAX_ROWS_PER_CHUNK:  # the usual case
        return [RowChunk(run_id, stream, machine_id, session_id, rows, sent)]
    return split_into_chunks(run_id, stream, rows, machine_id=machine_id, session_id=session_id)


def split_into_chunks(
    run_id: int, stream: Stream, rows: Rows, *, machine_id: int = 0, session_id: int = 0
) -> list[RowChunk]:
    """Return chunks of at most MAX_ROWS_PER_CHUNK rows; none if there are no rows."""
    return [
        RowChunk(run_id, stream, machine_id, session_id, rows[first : first + MAX_ROWS_PER_CHUNK])
        for first in range(0, rows.size, MAX_ROWS_PER_CHUNK)
    ]
