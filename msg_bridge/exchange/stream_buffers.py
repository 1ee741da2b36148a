"""Send and receive buffers of numbered rows.

`SendBuffer` numbers rows and keeps them until they are acknowledged. `ReceiveBuffer` drops
duplicates, keeps rows that arrived early, and lists gaps. Together they deliver every row once and
in order over a transport that drops, duplicates, delays and reorders messages.

Row numbers are unbounded here and modulo 2**32 in the field `seq`, so a run has no maximum length.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import STREAM_DTYPE, RowRange, Stream
from msg_bridge.contract.rows import Rows, copy_rows, empty_rows, join_rows
from msg_bridge.exchange.reorder_buffer import ReorderBuffer
from msg_bridge.exchange.row_digest import row_digest

__all__ = ["MAX_ROWS_IN_FLIGHT", "PIPELINE_DEPTH", "ReceiveBuffer", "SendBuffer", "check_row_range"]

PIPELINE_DEPTH = 1
"""Number of ticks that a machine is ahead of the soil's answers, so that both compute at once.

It is exactly this number in every tick but the first, however early an answer arrives: otherwise a
run would not be repeatable.
"""

MAX_ROWS_IN_FLIGHT = 4_000_000
"""Maximum number of rows of a tick; larger row numbers are invalid. Of rows beyond a gap only
`MAX_ROWS_AHEAD` are kept."""

_MODULUS = 2**32


def check_row_range(
    span: RowRange, stream: Stream, expected: int, *, allow_gap: bool = False
) -> None:
    """Check that a header counts a possible number of rows, which continue their stream.

    Args:
        span: the rows that the header counts.
        stream: their stream.
        expected: the first row that no earlier header counts.
        allow_gap: whether there may be headers in between that count rows.

    Raises:
        ExchangeError: ROW_RANGE.
    """
    ahead = span.first - expected
    continues = 0 <= ahead <= MAX_ROWS_IN_FLIGHT if allow_gap else ahead == 0
    if not 0 <= span.count <= MAX_ROWS_IN_FLIGHT or not continues:
        raise ExchangeError(
            f"a header counts {span.count} {stream.name} rows from {span.first}; the stream"
            f" continues at {expected}, with at most {MAX_ROWS_IN_FLIGHT} rows in a tick",
            ErrorCode.ROW_RANGE,
        )


class SendBuffer:
    """Rows sent, kept in memory until they are acknowledged."""

    def __init__(self, stream: Stream, first: int = 1, *, machine_id: int = 0) -> None:
        """
        Args:
            stream: the stream.
            first: number of its first row.
            machine_id: machine whose id is written into the rows; 0: they have their ids.
        """
        self.stream = stream
        self._machine_id = machine_id
        self._kept_rows: deque[tuple[RowRange, Rows]] = deque()
        self._next = first

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept."""
        return sum(rows.size for _, rows in self._kept_rows)

    def append(self, rows: Rows) -> tuple[Rows, RowRange]:
        """Number a copy of some rows and keep it.

        Returns:
            (the numbered rows, their range with its digest).
        """
        first = self._next
        if rows.size == 0:
            return rows, RowRange(first)
        numbered = copy_rows(rows, STREAM_DTYPE[self.stream])
        self._next += rows.size
        numbered["seq"] = np.arange(first, self._next)  # wraps modulo 2**32
        if self._machine_id:
            numbered["machine_id"] = self._machine_id
        span = RowRange(first, rows.size, row_digest(numbered))
        self._kept_rows.append((span, numbered))
        return numbered, span

    def kept_rows(self, wanted: RowRange) -> Rows:
        """Return the rows of a range that are still kept."""
        parts = []
        for span, rows in self._kept_rows:
            if span.last >= wanted.first and span.first <= wanted.last:
                begin = max(wanted.first - span.first, 0)
                parts.append(rows[begin : wanted.last + 1 - span.first])
        return join_rows(parts, STREAM_DTYPE[self.stream])

    def discard_through(self, through: int) -> None:
        """Discard each batch of rows that ends with row `through` or before."""
        while self._kept_rows and self._kept_rows[0][0].last <= through:
            self._kept_rows.popleft()


class ReceiveBuffer:
    """Rows received, each once and in order.

    Attributes:
        stream: the stream.
        expected: number of the first row that is not discarded.
        received: last number up to which no row is missing.
    """

    def __init__(self, stream: Stream, first: int = 1) -> None:
        """
        Args:
            stream: the stream.
            first: number of the first row expected.
        """
        self.stream = stream
        self.expected = first
        self._dtype = STREAM_DTYPE[stream]
        self._no_rows = empty_rows(self._dtype)
        self._ready: deque[Rows] = deque()  # rows from the first expected on, up to the first gap
        self.received = first - 1
        self._reorder_buffer = ReorderBuffer(self._dtype, first)  # rows beyond that gap

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept, those behind a gap included."""
        return sum(rows.size for rows in self._ready) + len(self._reorder_buffer)

    def check_type(self, rows: Rows) -> None:
        """Check that an array has the shape and the dtype of rows of the stream.

        Raises:
            ExchangeError: ROW_TYPE.
        """
        if rows.dtype != self._dtype or rows.ndim != 1:
            raise ExchangeError(
                f"{self.stream.name} rows must be a 1-D array of {self._dtype}, not"
                f" {rows.ndim}-D of {rows.dtype}",
                ErrorCode.ROW_TYPE,
            )

    def add(self, rows: Rows) -> int:
        """Add rows in any order, any number of times. Rows that continue the stream are not copied.

        Rows `MAX_ROWS_AHEAD` or more beyond the first missing one are dropped: they are requested
        again once a header counts them.

        Returns:
            The number of new rows.

        Raises:
            ExchangeError: ROW_TYPE; SEQUENCE_NUMBER: numbered far beyond all rows received.
        """
        self.check_type(rows)
        if rows.size == 0:
            return 0
        if not self._reorder_buffer and self._continues(rows):  # the usual case
            self._append(rows)
            return rows.size
        # Of all numbers equal modulo 2**32, the nearest to the first one expected.
        ahead = (rows["seq"].astype(np.int64) - self.expected) % _MODULUS
        numbers = self.expected + np.where(ahead >= _MODULUS // 2, ahead - _MODULUS, ahead)
        is_new = numbers > self.received
        if not is_new.any():
            return 0
        furthest = int(numbers.max()) - self.expected
        if furthest >= MAX_ROWS_IN_FLIGHT:
            raise ExchangeError(
                f"a {self.stream.name} row is {furthest} rows beyond the first one expected; its"
                " sender numbers from another start",
                ErrorCode.SEQUENCE_NUMBER,
            )
        if not self._reorder_buffer:
            self._reorder_buffer = ReorderBuffer(self._dtype, self.received + 1)
        num_new = self._reorder_buffer.add(numbers[is_new], rows[is_new])
        self._append(self._reorder_buffer.pop_contiguous(self.received + 1))
        return num_new

    def missing(self, span: RowRange) -> list[RowRange]:
        """Return the gaps in a range; discarded rows are no gaps."""
        last = span.last
        if last <= self.received:  # the usual case, several times in a tick
            return []
        first = max(span.first, self.received + 1)
        return self._reorder_buffer.missing(RowRange(first, last + 1 - first))

    def rows(self, span: RowRange) -> Rows:
        """Return the rows of a range, which must not be modified.

        Raises:
            ExchangeError: MISSING_ROWS: the range has a gap or was discarded.
        """
        if span.first < self.expected or span.last > self.received:
            raise ExchangeError(
                f"{self.stream.name} rows {span.first}..{span.last} are incomplete or discarded",
                ErrorCode.MISSING_ROWS,
            )
        if span.count == 0:
            return self._no_rows
        if span.first == self.expected and span.count == self._ready[0].size:  # the usual case
            return self._ready[0]
        parts, number = [], self.expected
        for rows in self._ready:
            if number > span.last:
                break
            parts.append(rows[max(span.first - number, 0) : span.last + 1 - number])
            number += rows.size
        return join_rows(parts, self._dtype)

    def discard_through(self, through: int) -> None:
        """Discard rows up to and including `through`; they count as duplicates from now on."""
        drop = through + 1 - self.expected
        if drop <= 0:
            return
        self.expected = through + 1
        while self._ready and self._ready[0].size <= drop:
            drop -= self._ready.popleft().size
        if self._ready:
            self._ready[0] = self._ready[0][drop:]
        if through > self.received:
            self.received = through
            self._append(self._reorder_buffer.pop_contiguous(through + 1))

    def clear(self) -> None:
        """Discard all rows that are not yet discarded; they are missing from now on."""
        self._ready.clear()
        self.received = self.expected - 1
        self._reorder_buffer = ReorderBuffer(self._dtype, self.expected)

    def _continues(self, rows: Rows) -> bool:
        """Return whether rows are the next ones, in order."""
        if self.received + rows.size - self.expected >= MAX_ROWS_IN_FLIGHT:
            return False
        first = (self.received + 1) % _MODULUS
        # For a few rows faster than NumPy; rows in which the numbers wrap are the unusual case.
        return bool(rows["seq"].tolist() == list(range(first, first + rows.size)))

    def _append(self, rows: Rows) -> None:
        if rows.size:
            self._ready.append(rows)
            self.received += rows.size
