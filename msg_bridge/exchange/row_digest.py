"""Digests of rows, by which a header commits to the rows that it counts."""

from __future__ import annotations

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import RowRange, Stream
from msg_bridge.contract.row_ranges import bytes_digest
from msg_bridge.contract.rows import Rows

__all__ = ["check_row_digest", "row_digest"]


def row_digest(rows: Rows) -> int:
    """Return the SHA-256 digest of numbered rows, cut to an int64; 0 without rows."""
    return bytes_digest(rows.tobytes()) if rows.size else 0


def check_row_digest(rows: Rows, span: RowRange, stream: Stream) -> None:
    """Check rows against the digest in the header that counts them.

    Args:
        rows: the rows that have arrived with the numbers of the range.
        span: range and digest in the header.
        stream: their stream.

    Raises:
        ExchangeError: ROW_DIGEST.
    """
    if row_digest(rows) != span.digest:
        raise ExchangeError(
            f"{stream.name} rows {span.first} to {span.last} are not those that their header"
            " states: another publisher sends rows or headers; they are requested again",
            ErrorCode.ROW_DIGEST,
        )
