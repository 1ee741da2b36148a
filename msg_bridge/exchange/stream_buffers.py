"""Numbered row streams: what was sent is remembered, what was received is put in order.

`SendBuffer` numbers rows and keeps them until they may be forgotten; `ReceiveBuffer` drops duplicates,
holds early rows, and names gaps. Together they make a transport that drops, duplicates, delays
and reorders as good as a perfect one.

Numbers are whole numbers here and modulo 2**32 in the rows' `seq`, so that a run may last.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import STREAM_DTYPE, RowRange, Stream
from msg_bridge.contract.rows import Rows, empty_rows, join_rows
from msg_bridge.exchange.reorder_buffer import ReorderBuffer

__all__ = ["MAX_ROWS_IN_FLIGHT", "PIPELINE_DEPTH", "ReceiveBuffer", "SendBuffer", "check_row_range"]

PIPELINE_DEPTH = 1
"""Ticks a machine is ahead of the soil's answers: while the soil works on one, it does the next.

In every tick but its first it does exactly that many more than it has been answered, no matter how
soon an answer comes: otherwise a run would not repeat.
"""

MAX_ROWS_IN_FLIGHT = 4_000_000
"""Rows one tick may count, and a row may run ahead of a gap; more means a broken number."""

_MODULUS = 2**32


def check_row_range(
    span: RowRange, stream: Stream, expected: int, *, skipping: bool = False
) -> None:
    """Refuse a header that counts rows no tick can have, or counts them from another start.

    Args:
        span: what the header counts.
        stream: of which rows.
        expected: the first row that no header before it counts.
        skipping: there were headers in between that count rows, too.

    Raises:
        ExchangeError: saying which.
    """
    ahead = span.first - expected
    right_start = 0 <= ahead <= MAX_ROWS_IN_FLIGHT if skipping else ahead == 0
    if not 0 <= span.count <= MAX_ROWS_IN_FLIGHT or not right_start:
        raise ExchangeError(
            f"a header counts {span.count} {stream.name} rows from {span.first}; rows go on"
            f" from {expected}, at most {MAX_ROWS_IN_FLIGHT} in a tick"
        )


class SendBuffer:
    """Rows sent, kept in memory until forgotten."""

    def __init__(self, stream: Stream, first: int = 1) -> None:
        """`first` is the number of the first row."""
        self.stream = stream
        self._kept_rows: deque[tuple[RowRange, Rows]] = deque()
        self._next = first

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept."""
        return sum(rows.size for _, rows in self._kept_rows)

    def append(self, rows: Rows) -> tuple[Rows, RowRange]:
        """Number a copy of some rows and remember it; no rows come back as they are.

        Returns:
            (the numbered rows, their range).
        """
        span = RowRange(self._next, rows.size)
        if rows.size == 0:
            return rows, span
        numbered = rows.copy()
        self._next += rows.size
        numbered["seq"] = np.arange(span.first, self._next)  # modulo 2**32, as the field is
        self._kept_rows.append((span, numbered))
        return numbered, span

    def kept_rows(self, wanted: RowRange) -> Rows:
        """The rows asked for again, as far as they are still kept."""
        parts = []
        for span, rows in self._kept_rows:
            if span.last >= wanted.first and span.first <= wanted.last:
                begin = max(wanted.first - span.first, 0)
                parts.append(rows[begin : wanted.last + 1 - span.first])
        return join_rows(parts, STREAM_DTYPE[self.stream])

    def discard_through(self, through: int) -> None:
        """Drop what was sent together and ends with row `through` or before."""
        while self._kept_rows and self._kept_rows[0][0].last <= through:
            self._kept_rows.popleft()


class ReceiveBuffer:
    """Rows received, in order, each once."""

    def __init__(self, stream: Stream, first: int = 1) -> None:
        """`first` is the number of the first row expected."""
        self.stream = stream
        self._first = first
        self._dtype = STREAM_DTYPE[stream]
        self._no_rows = empty_rows(self._dtype)
        self._ready: deque[Rows] = deque()  # from the first one expected on, before the first gap
        self._received = first - 1
        self._reorder_buffer = ReorderBuffer(self._dtype)  # behind that gap

    @property
    def expected(self) -> int:
        """Number of the first row that is not forgotten."""
        return self._first

    @property
    def received(self) -> int:
        """Last number up to which nothing is missing."""
        return self._received

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept, those behind a gap included."""
        return sum(rows.size for rows in self._ready) + len(self._reorder_buffer)

    def add(self, rows: Rows) -> int:
        """Take rows in any order, any number of times; those that are next are not copied.

        Returns:
            How many were new.

        Raises:
            ExchangeError: rows of another type, or numbered far beyond any gap.
        """
        if rows.dtype != self._dtype or rows.ndim != 1:
            raise ExchangeError(
                f"{self.stream.name} rows must be a 1-D array of {self._dtype}, not"
                f" {rows.ndim}-D of {rows.dtype}"
            )
        if rows.size == 0:
            return 0
        if not self._reorder_buffer and self._continues(rows):  # nearly always
            self._append(rows)
            return rows.size
        # The nearest number to the first one expected that is the same modulo 2**32.
        ahead = (rows["seq"].astype(np.int64) - self._first) % _MODULUS
        numbers = self._first + np.where(ahead >= _MODULUS // 2, ahead - _MODULUS, ahead)
        new = numbers > self._received
        if not new.any():
            return 0
        furthest = int(numbers.max()) - self._first
        if furthest >= MAX_ROWS_IN_FLIGHT:
            raise ExchangeError(
                f"a {self.stream.name} row is {furthest} rows ahead of what has come;"
                " the sender counts from another start"
            )
        fresh = self._reorder_buffer.add(numbers[new], rows[new])
        self._append(self._reorder_buffer.pop_contiguous(self._received + 1))
        return fresh

    def missing(self, span: RowRange) -> list[RowRange]:
        """Gaps in a range, as ranges; what is forgotten is none."""
        last = span.last
        if last <= self._received:  # nearly always, and asked several times a tick
            return []
        first = max(span.first, self._received + 1)
        return self._reorder_buffer.missing(RowRange(first, last + 1 - first))

    def rows(self, span: RowRange) -> Rows:
        """The rows of a range that has no gap and is not forgotten; not to be written to."""
        if span.first < self._first or span.last > self._received:
            raise ExchangeError(f"{self.stream.name} rows {span.first}..{span.last} are not here")
        if span.count == 0:
            return self._no_rows
        if span.first == self._first and span.count == self._ready[0].size:  # nearly always
            return self._ready[0]
        parts, number = [], self._first
        for rows in self._ready:
            if number > span.last:
                break
            parts.append(rows[max(span.first - number, 0) : span.last + 1 - number])
            number += rows.size
        return join_rows(parts, self._dtype)

    def discard_through(self, through: int) -> None:
        """Drop rows up to and with `through`; they are taken for duplicates from now on."""
        drop = through + 1 - self._first
        if drop <= 0:
            return
        self._first = through + 1
        while self._ready and self._ready[0].size <= drop:
            drop -= self._ready.popleft().size
        if self._ready:
            self._ready[0] = self._ready[0][drop:]
        if through > self._received:
            self._received = through
            self._append(self._reorder_buffer.pop_contiguous(through + 1))

    def _continues(self, rows: Rows) -> bool:
        """Whether rows are the next ones, in order."""
        seq = rows["seq"]
        if int(seq[0]) != (self._received + 1) % _MODULUS:
            return False
        if self._received + rows.size - self._first >= MAX_ROWS_IN_FLIGHT:
            return False
        steps = seq[1:] - seq[:-1]  # modulo 2**32, as the numbers are
        return not np.count_nonzero(steps != 1)

    def _append(self, rows: Rows) -> None:
        if rows.size:
            self._ready.append(rows)
            self._received += rows.size
