"""Send and receive buffers of numbered rows.

`SendBuffer` numbers rows and keeps them until they are acknowledged. `ReceiveBuffer` drops
duplicates, keeps rows that arrived early, and lists gaps. Together they deliver every row once and
in order over a transport that drops, duplicates, delays and reorders messages.

Row numbers are unbounded here and modulo 2**32 in the field `seq`, so a run has no maximum length.
"""

from __future__ import annotations

from collections import deque
from functools import lru_cache

import numpy as np

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import STREAM_DTYPE, NumberedRows, RowRange, Stream
from msg_bridge.contract.row_ranges import SentRange
from msg_bridge.contract.rows import Rows, are_of_machine, join_rows, no_rows
from msg_bridge.exchange.reorder_buffer import ReorderBuffer
from msg_bridge.exchange.row_digest import check_row_digest

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

_DTYPES_IN_CACHE = 64
"""Number of pairs of row types of which it is kept whether they are equal."""


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
        self._dtype = STREAM_DTYPE[stream]
        self._kept_rows: deque[NumberedRows] = deque()
        self._next = first  # number of the next row
        self._none: NumberedRows | None = None  # no rows, where that one is the next

    @property
    def is_empty(self) -> bool:
        """Whether no rows are kept."""
        return not self._kept_rows

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept."""
        return sum(each.span.count for each in self._kept_rows)

    def append(self, rows: Rows) -> NumberedRows:
        """Number a copy of some rows and keep it.

        Raises:
            ValueError: the rows are of another dtype.
        """
        count = rows.size
        first = self._next
        if count == 0:  # as in most ticks of most streams
            if self._none is None:
                self._none = NumberedRows(no_rows(self._dtype), RowRange(first))
            return self._none
        if rows.dtype is not self._dtype and not _are_equal(rows.dtype, self._dtype):
            raise ValueError(f"rows of {rows.dtype} were given where {self._dtype} is required")
        # NumPy copies structured arrays field by field, which takes longer than all of this.
        data = bytearray(rows.tobytes())
        copy: Rows = np.frombuffer(data, self._dtype)
        copy["seq"] = np.arange(first, first + count)  # wraps modulo 2**32
        if self._machine_id:
            copy["machine_id"] = self._machine_id
        numbered = NumberedRows(copy, SentRange.of(first, count, bytes(data)), self._machine_id)
        self._kept_rows.append(numbered)
        self._next, self._none = first + count, None
        return numbered

    def kept_rows(self, wanted: RowRange) -> Rows:
        """Return the rows of a range that are still kept."""
        parts = []
        for rows, span, *_ in self._kept_rows:
            if span.last >= wanted.first and span.first <= wanted.last:
                begin = max(wanted.first - span.first, 0)
                parts.append(rows[begin : wanted.last + 1 - span.first])
        return join_rows(parts, self._dtype)

    def discard_through(self, through: int) -> None:
        """Discard each batch of rows that ends with row `through` or before."""
        while self._kept_rows and self._kept_rows[0].span.last <= through:
            self._kept_rows.popleft()


class ReceiveBuffer:
    """Rows received, each once and in order.

    Attributes:
        stream: the stream.
        expected: number of the first row that is not discarded.
        received: last number up to which no row is missing.
    """

    def __init__(self, stream: Stream, first: int = 1, *, machine_id: int = 0) -> None:
        """
        Args:
            stream: the stream.
            first: number of the first row expected.
            machine_id: machine whose id all rows must have; 0: any.
        """
        self.stream = stream
        self.expected = first
        self._machine_id = machine_id
        self._dtype = STREAM_DTYPE[stream]
        self._no_rows = no_rows(self._dtype)
        # Rows from the first expected on, up to the first gap, and as which they were sent.
        self._ready: deque[tuple[Rows, NumberedRows | None]] = deque()
        self.received = first - 1
        self._reorder_buffer: ReorderBuffer | None = None  # rows beyond that gap, if there are any

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept, those behind a gap included."""
        num_early = 0 if self._reorder_buffer is None else len(self._reorder_buffer)
        return sum(rows.size for rows, _ in self._ready) + num_early

    def _check(self, rows: Rows) -> None:
        """Check that an array has rows of the stream, and of the machine that sends them.

        Raises:
            ExchangeError: ROW_TYPE or SENDER_MISMATCH.
        """
        if rows.dtype != self._dtype or rows.ndim != 1:
            raise ExchangeError(
                f"{self.stream.name} rows must be a 1-D array of {self._dtype}, not"
                f" {rows.ndim}-D of {rows.dtype}",
                ErrorCode.ROW_TYPE,
            )
        if self._machine_id and not are_of_machine(rows, self._machine_id):
            raise ExchangeError(
                f"machine {self._machine_id} sends rows with another machine id",
                ErrorCode.SENDER_MISMATCH,
            )

    def add(self, rows: Rows, sent: NumberedRows | None = None) -> int:
        """Add rows in any order, any number of times. Rows that continue the stream are not copied.

        Rows `MAX_ROWS_AHEAD` or more beyond the first missing one are dropped: they are requested
        again once a header counts them.

        Args:
            rows: the rows.
            sent: as which they were sent, if that was in this process.

        Returns:
            The number of new rows.

        Raises:
            ExchangeError: ROW_TYPE, SENDER_MISMATCH; SEQUENCE_NUMBER: numbered far beyond all rows
                received.
        """
        if sent is not None and sent.rows is rows and self._is_next(sent):
            self._append(rows, sent)
            return sent.span.count
        self._check(rows)
        if rows.size == 0:
            return 0
        if self._reorder_buffer is None and self._continues(rows):  # the usual case
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
        if self._reorder_buffer is None:
            self._reorder_buffer = ReorderBuffer(self._dtype, self.received + 1)
        num_new = self._reorder_buffer.add(numbers[is_new], rows[is_new])
        self._append_early_rows()
        return num_new

    def missing(self, span: RowRange) -> list[RowRange]:
        """Return the gaps in a range; discarded rows are no gaps."""
        last = span.last
        if last <= self.received or span.count == 0:  # as in most ticks
            return []
        first = max(span.first, self.received + 1)
        wanted = RowRange(first, last + 1 - first)
        return [wanted] if self._reorder_buffer is None else self._reorder_buffer.missing(wanted)

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
        return self._select(span.first, span.last)

    def checked_rows(self, span: RowRange) -> Rows:
        """Return the rows of a range whose digest a header states.

        Raises:
            ExchangeError: MISSING_ROWS; ROW_DIGEST: they are not those of the header.
        """
        if span.count == 0 and span.digest == 0:  # as in most ticks
            return self._no_rows
        if span.first == self.expected and self._ready:
            rows, sent = self._ready[0]
            if sent is not None and sent.span is span and self._are_as_sent(sent):
                return rows
        rows = self.rows(span)
        check_row_digest(rows, span, self.stream)
        return rows

    def _are_as_sent(self, sent: NumberedRows) -> bool:
        """Return whether rows that were sent in this process certainly have not been modified."""
        span = sent.span
        return isinstance(span, SentRange) and sent.rows.tobytes() == span.memory

    def rows_through(self, last: int) -> Rows | None:
        """Return the rows that are not discarded, through number `last`; None if any is missing.

        They must not be modified.
        """
        return None if last > self.received else self._select(self.expected, last)

    def _select(self, first: int, last: int) -> Rows:
        """Return the rows from `first` to `last`, which are here."""
        if last < first:
            return self._no_rows
        if first == self.expected and last + 1 - first == self._ready[0][0].size:  # the usual case
            return self._ready[0][0]
        parts, number = [], self.expected
        for rows, _ in self._ready:
            if number > last:
                break
            parts.append(rows[max(first - number, 0) : last + 1 - number])
            number += rows.size
        return join_rows(parts, self._dtype)

    def discard_through(self, through: int) -> None:
        """Discard rows up to and including `through`; they count as duplicates from now on."""
        drop = through + 1 - self.expected
        if drop <= 0:
            return
        self.expected = through + 1
        while self._ready and self._ready[0][0].size <= drop:
            drop -= self._ready.popleft()[0].size
        if self._ready and drop:
            self._ready[0] = self._ready[0][0][drop:], None
        if through > self.received:
            self.received = through
            if self._reorder_buffer is not None:
                self._append_early_rows()

    def clear(self) -> None:
        """Discard all rows that are not yet discarded; they are missing from now on."""
        self._ready.clear()
        self.received = self.expected - 1
        self._reorder_buffer = None

    def _is_next(self, sent: NumberedRows) -> bool:
        """Return whether numbered rows are the next ones, of the right type and machine."""
        return (
            self._reorder_buffer is None
            and sent.span.first == self.received + 1
            and sent.span.last - self.expected < MAX_ROWS_IN_FLIGHT
            and sent.rows.dtype == self._dtype
            and (not self._machine_id or sent.machine_id == self._machine_id)
        )

    def _continues(self, rows: Rows) -> bool:
        """Return whether rows are the next ones, in order."""
        if self.received + rows.size - self.expected >= MAX_ROWS_IN_FLIGHT:
            return False
        first = (self.received + 1) % _MODULUS
        # For a few rows faster than NumPy; rows in which the numbers wrap are the unusual case.
        return bool(rows["seq"].tolist() == list(range(first, first + rows.size)))

    def _append(self, rows: Rows, sent: NumberedRows | None = None) -> None:
        """Append the next rows, of which there is at least one."""
        self._ready.append((rows, sent))
        self.received += rows.size

    def _append_early_rows(self) -> None:
        """Append the rows that were received early and are the next ones now."""
        assert self._reorder_buffer is not None
        rows = self._reorder_buffer.pop_contiguous(self.received + 1)
        if rows.size:
            self._append(rows)
        if not self._reorder_buffer:
            self._reorder_buffer = None


@lru_cache(maxsize=_DTYPES_IN_CACHE)
def _are_equal(dtype: np.dtype[np.void], other: np.dtype[np.void]) -> bool:
    """Return whether two row types are equal.

    NumPy compares them field by field. Each kernel returns rows with its own dtype object.
    """
    return dtype == other
