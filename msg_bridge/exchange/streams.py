"""Numbered row streams: what was sent is remembered, what was received is put in order.

`Outgoing` numbers rows and keeps them until they may be forgotten; `Incoming` drops duplicates,
holds early rows, and names gaps. Together they make a transport that drops, duplicates, delays
and reorders as good as a perfect one.

Numbers are whole numbers here and modulo 2**32 in the rows' `seq`, so that a run may last.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import STREAM_DTYPE, RowRange, Stream
from msg_bridge.contract.rows import Rows, empty_rows

__all__ = ["AHEAD", "WINDOW", "Incoming", "Outgoing", "check_span"]

AHEAD = 1
"""Ticks a machine is ahead of the soil's answers: while the soil works on one, it does the next.

In every tick but its first it does exactly that many more than it has been answered, no matter how
soon an answer comes: otherwise a run would not repeat.
"""

WINDOW = 4_000_000
"""Rows one tick may count, and a row may run ahead of a gap; more means a broken number."""

_MODULUS = 2**32
_ROOM = 256


def check_span(span: RowRange, stream: Stream, expected: int, *, skipping: bool = False) -> None:
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
    right_start = 0 <= ahead <= WINDOW if skipping else ahead == 0
    if not 0 <= span.count <= WINDOW or not right_start:
        raise ExchangeError(
            f"a header counts {span.count} {stream.name} rows from {span.first}; rows go on"
            f" from {expected}, at most {WINDOW} in a tick"
        )


class Outgoing:
    """Rows sent, kept in memory until forgotten."""

    def __init__(self, stream: Stream, first: int = 1) -> None:
        """`first` is the number of the first row."""
        self.stream = stream
        self._kept: deque[tuple[RowRange, Rows]] = deque()
        self._next = first

    def append(self, rows: Rows) -> tuple[Rows, RowRange]:
        """Number a copy of some rows and remember it.

        Returns:
            (the numbered rows, their range).
        """
        span = RowRange(self._next, rows.size)
        numbered = rows.copy()
        numbered["seq"] = (span.first + np.arange(rows.size, dtype=np.int64)) % _MODULUS
        self._next += rows.size
        if rows.size:
            self._kept.append((span, numbered))
        return numbered, span

    def again(self, wanted: RowRange) -> Rows:
        """The rows asked for again, as far as they are still kept."""
        parts = [empty_rows(STREAM_DTYPE[self.stream])]
        for span, rows in self._kept:
            if span.last >= wanted.first and span.first <= wanted.last:
                begin = max(wanted.first - span.first, 0)
                parts.append(rows[begin : wanted.last + 1 - span.first])
        return np.concatenate(parts)

    def forget(self, through: int) -> None:
        """Drop what was sent together and ends with row `through` or before."""
        while self._kept and self._kept[0][0].last <= through:
            self._kept.popleft()


class Incoming:
    """Rows received, in order, each once."""

    def __init__(self, stream: Stream, first: int = 1) -> None:
        """`first` is the number of the first row expected."""
        self.stream = stream
        self._first = first
        self._ready = 0  # rows from the first one expected on, before the first gap
        self._clear()

    @property
    def expected(self) -> int:
        """Number of the first row that is not forgotten."""
        return self._first

    @property
    def received(self) -> int:
        """Last number up to which nothing is missing."""
        return self._first - 1 + self._ready

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
        if self._continues(rows):  # nearly always
            end = self._ready + rows.size
            self._grow(end)
            self._buffer[self._ready : end] = rows
            self._have[self._ready : end] = True
            self._ready = end
            return rows.size
        # The nearest number to the first one expected that is the same modulo 2**32.
        ahead = (rows["seq"].astype(np.int64) - self._first) % _MODULUS
        index = np.where(ahead >= _MODULUS // 2, ahead - _MODULUS, ahead)
        new = index >= 0  # earlier rows were had and forgotten
        rows, index = rows[new], index[new]
        if index.size == 0:
            return 0
        if int(index.max()) >= WINDOW:
            raise ExchangeError(
                f"a {self.stream.name} row is {int(index.max())} rows ahead of what has come;"
                " the sender counts from another start"
            )
        self._grow(int(index.max()) + 1)
        index, where = np.unique(index, return_index=True)
        fresh = ~self._have[index]
        self._buffer[index[fresh]] = rows[where[fresh]]
        self._have[index[fresh]] = True
        self._find_gap()
        return int(fresh.sum())

    def _continues(self, rows: Rows) -> bool:
        """Whether rows are the next ones, in order, and none that follows is here already."""
        if rows.size == 0:
            return True
        seq = rows["seq"]
        if int(seq[0]) != (self._first + self._ready) % _MODULUS:
            return False
        if self._ready + rows.size > WINDOW:
            return False
        steps = seq[1:] - seq[:-1]  # modulo 2**32, as the numbers are
        return bool((steps == 1).all()) and not self._have[self._ready :].any()

    def missing(self, span: RowRange) -> list[RowRange]:
        """Gaps in a range, as ranges."""
        low = max(span.first - self._first, 0)
        high = max(span.last + 1 - self._first, low)
        if high == low or high <= self._ready:  # nearly always, and asked several times a tick
            return []
        self._grow(high)
        have = self._have[low:high]
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
        drop = through + 1 - self._first
        if drop <= 0:
            return
        self._first = through + 1
        buffer, have = self._buffer[drop:], self._have[drop:]
        if self._have.size == _ROOM and not have.any():  # nearly always
            self._have[:drop] = False
            self._ready = 0
            return
        self._clear()
        if have.any():
            self._grow(have.size)
            self._buffer[: have.size], self._have[: have.size] = buffer, have
            self._find_gap()

    def _find_gap(self) -> None:
        missing = np.flatnonzero(~self._have)
        self._ready = int(missing[0]) if missing.size else self._have.size

    def _clear(self) -> None:
        self._buffer: Rows = empty_rows(STREAM_DTYPE[self.stream], _ROOM)
        self._have: NDArray[np.bool_] = np.zeros(_ROOM, dtype=np.bool_)
        self._ready = 0

    def _grow(self, size: int) -> None:
        if size > self._have.size:
            more = max(size, 2 * self._have.size) - self._have.size
            self._buffer = np.concatenate([self._buffer, empty_rows(self._buffer.dtype, more)])
            self._have = np.concatenate([self._have, np.zeros(more, dtype=np.bool_)])
