"""Numbered row streams: what was sent is remembered, what was received is put in order.

`Outgoing` numbers rows and keeps them until they may be forgotten; `Incoming` drops duplicates,
holds early rows, and names gaps. Together they make a transport that drops, duplicates, delays
and reorders as good as a perfect one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import STREAM_DTYPE, RowRange, Stream
from msg_bridge.contract.rows import Rows, empty_rows

__all__ = ["Incoming", "Outgoing"]

_WINDOW = 4_000_000
"""Rows a stream may run ahead of what was forgotten; more means a broken number."""


class Outgoing:
    """Rows sent, kept in memory until forgotten."""

    def __init__(self, stream: Stream) -> None:
        self.stream = stream
        self._kept: Rows = empty_rows(STREAM_DTYPE[stream])
        self._next = 1

    @property
    def last(self) -> int:
        """Sequence number of the last row sent; 0 before the first."""
        return self._next - 1

    def append(self, rows: Rows) -> tuple[Rows, RowRange]:
        """Number rows and remember them.

        Returns:
            (the numbered rows, their range).
        """
        numbered = rows.copy()
        numbered["seq"] = np.arange(self._next, self._next + rows.size)
        span = RowRange(self._next, rows.size)
        self._next += rows.size
        self._kept = np.concatenate([self._kept, numbered])
        return numbered, span

    def again(self, first: int, count: int) -> Rows:
        """The rows asked for again, as far as they are still kept."""
        start = self._next - self._kept.size
        low = max(first - start, 0)
        return self._kept[low : max(first + count - start, low)]

    def forget(self, through: int) -> None:
        """Drop rows up to and with sequence number `through`."""
        start = self._next - self._kept.size
        self._kept = self._kept[min(max(through + 1 - start, 0), self._kept.size) :]


class Incoming:
    """Rows received, in order, each once."""

    def __init__(self, stream: Stream, first: int = 1) -> None:
        """`first` is the sequence number of the first row expected."""
        self.stream = stream
        self._first = first
        self._buffer: Rows = empty_rows(STREAM_DTYPE[stream], 256)
        self._have: NDArray[np.bool_] = np.zeros(256, dtype=np.bool_)

    @property
    def received(self) -> int:
        """Last sequence number up to which nothing is missing."""
        missing = np.nonzero(~self._have)[0]
        return self._first - 1 + (int(missing[0]) if missing.size else self._have.size)

    def add(self, rows: Rows) -> int:
        """Take rows in any order, any number of times.

        Returns:
            How many were new.

        Raises:
            ExchangeError: rows of another type, or numbered far beyond any gap.
        """
        if rows.dtype != self._buffer.dtype or rows.ndim != 1:
            raise ExchangeError(
                f"{self.stream.name} rows must be a 1-D array of {self._buffer.dtype}, not"
                f" {rows.ndim}-D of {rows.dtype}"
            )
        index = rows["seq"].astype(np.int64) - self._first
        ahead = index >= 0  # earlier rows were had and forgotten
        rows, index = rows[ahead], index[ahead]
        if index.size == 0:
            return 0
        if int(index.max()) >= _WINDOW:
            raise ExchangeError(
                f"{self.stream.name} row {int(rows['seq'].max())} is {int(index.max())} rows ahead;"
                " the sender counts from another start"
            )
        self._grow(int(index.max()) + 1)
        index, where = np.unique(index, return_index=True)
        fresh = ~self._have[index]
        self._buffer[index[fresh]] = rows[where[fresh]]
        self._have[index[fresh]] = True
        return int(fresh.sum())

    def missing(self, span: RowRange) -> list[RowRange]:
        """Gaps in a range, as ranges."""
        self._grow(span.last - self._first + 1)
        low = max(span.first - self._first, 0)
        have = self._have[low : max(span.last - self._first + 1, low)]
        edges = np.flatnonzero(np.diff(np.concatenate([[True], have, [True]]).astype(np.int8)))
        begin, end = edges[0::2], edges[1::2]
        return [
            RowRange(self._first + low + int(b), int(e - b))
            for b, e in zip(begin, end, strict=True)
        ]

    def rows(self, span: RowRange) -> Rows:
        """The rows of a range that has no gap and is not forgotten."""
        low = span.first - self._first
        if low < 0 or self.missing(span):
            raise ExchangeError(f"{self.stream.name} rows {span.first}..{span.last} are not here")
        return self._buffer[low : low + span.count].copy()

    def forget(self, through: int) -> None:
        """Drop rows up to and with `through`; they are taken for duplicates from now on."""
        drop = min(max(through + 1 - self._first, 0), self._have.size)
        self._buffer = np.concatenate([self._buffer[drop:], np.zeros_like(self._buffer[:drop])])
        self._have = np.concatenate([self._have[drop:], np.zeros(drop, dtype=np.bool_)])
        self._first = max(self._first, through + 1)

    def _grow(self, size: int) -> None:
        if size > self._have.size:
            more = max(size, 2 * self._have.size) - self._have.size
            self._buffer = np.concatenate([self._buffer, empty_rows(self._buffer.dtype, more)])
            self._have = np.concatenate([self._have, np.zeros(more, dtype=np.bool_)])
