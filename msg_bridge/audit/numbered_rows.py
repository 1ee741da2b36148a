"""Rows of a stream sorted by number, and the ranges of rows that headers count."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.messages import STREAM_DTYPE, RowRange, Stream
from msg_bridge.contract.rows import Rows, empty_rows

__all__ = ["NumberedRows", "Numbers", "Spans", "contiguous_ranges", "order_rows"]

Numbers = NDArray[np.int64]
"""Row numbers, ticks or volumes [mm^3], shape (n,)."""

_MODULUS = 2**32
"""Modulus of `seq` in rows."""


@dataclass(frozen=True)
class NumberedRows:
    """Rows of one stream.

    Attributes:
        numbers: numbers of the rows, ascending, not wrapped (`seq` of a row is modulo 2**32).
        rows: the rows, shape (n,).
        duplicates: number of further rows with the number and the content of one of these.
        conflicts: numbers of rows that were received with different contents.
    """

    numbers: Numbers
    rows: Rows
    duplicates: int
    conflicts: Numbers

    def count_through(self, last: Numbers) -> Numbers:
        """Return the number of rows with a number up to each of `last`, shape (n,)."""
        return np.searchsorted(self.numbers, last, side="right")


def order_rows(stream: Stream, chunks: Sequence[Rows], first: int | None) -> NumberedRows:
    """Sort the rows of a stream by number and remove duplicates.

    Args:
        stream: the stream.
        chunks: its rows as recorded.
        first: number of some early row, from a header; None if there is no header.
    """
    rows = np.concatenate([empty_rows(STREAM_DTYPE[stream]), *chunks])
    seq = rows["seq"].astype(np.int64)
    if not seq.size:
        return NumberedRows(seq, rows, 0, seq)
    half = _MODULUS // 2
    # Unwrap: consecutive rows are less than half the modulus apart, forward or backward.
    steps = (np.diff(seq) + half) % _MODULUS - half
    numbers = seq[0] + np.concatenate([[0], np.cumsum(steps)])
    if first is not None:
        numbers += round((first - int(numbers.min())) / _MODULUS) * _MODULUS
    if (np.diff(numbers) > 0).all():
        return NumberedRows(numbers, rows, 0, numbers[:0])
    order = np.argsort(numbers, kind="stable")
    numbers, rows = numbers[order], rows[order]
    is_repeat = np.concatenate([[False], numbers[1:] == numbers[:-1]])
    first_of = np.flatnonzero(~is_repeat)[np.cumsum(~is_repeat) - 1]
    content = np.ascontiguousarray(rows).view(np.uint8).reshape(rows.size, -1)
    differs = np.zeros(rows.size, dtype=np.bool_)
    differs[is_repeat] = (content[is_repeat] != content[first_of[is_repeat]]).any(axis=1)
    conflicts = np.unique(numbers[differs])
    num_duplicates = int(is_repeat.sum()) - int(differs.sum())
    return NumberedRows(numbers[~is_repeat], rows[~is_repeat], num_duplicates, conflicts)


@dataclass(frozen=True)
class Spans:
    """Ranges of rows that headers count, one for each header, in order.

    Attributes:
        ticks: ticks of the headers, ascending, shape (n,).
        first, last: number of the first and the last row of each; last = first - 1 if there is
            none, shape (n,).
    """

    ticks: Numbers
    first: Numbers
    last: Numbers

    @classmethod
    def of(cls, ticks: Iterable[int], ranges: Iterable[RowRange]) -> Spans:
        """Build from the ticks and ranges of headers."""
        ranges = list(ranges)
        return cls(
            np.array(list(ticks), dtype=np.int64),
            np.array([each.first for each in ranges], dtype=np.int64),
            np.array([each.last for each in ranges], dtype=np.int64),
        )

    @property
    def total(self) -> int:
        """Number of counted rows."""
        return int((self.last - self.first + 1).sum())

    def tick_of(self, numbers: Numbers) -> Numbers:
        """Return the tick of the first header that ends at or after each row, or the last tick."""
        index = np.searchsorted(self.last, numbers, side="left")
        return self.ticks[np.minimum(index, self.ticks.size - 1)]

    def discontinuities(self) -> NDArray[np.intp]:
        """Return indices of headers that do not start where the header of the tick before ends."""
        follows = self.ticks[1:] == self.ticks[:-1] + 1
        return np.flatnonzero(follows & (self.first[1:] != self.last[:-1] + 1)) + 1

    def missing(self, rows: NumberedRows) -> list[tuple[int, int]]:
        """Return (first, last) number of each gap among the counted rows.

        Rows between two headers belong to headers that are missing themselves; they count too.
        """
        if not self.ticks.size or self.last[-1] < self.first[0]:
            return []
        low, high = int(self.first[0]), int(self.last[-1])
        present = rows.numbers[(rows.numbers >= low) & (rows.numbers <= high)]
        edges = np.concatenate([[low - 1], present, [high + 1]])
        before = np.flatnonzero(np.diff(edges) > 1)
        return [(int(edges[k]) + 1, int(edges[k + 1]) - 1) for k in before]


def contiguous_ranges(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Return (first, last) of each range without a gap among ascending whole numbers."""
    values = np.asarray(numbers, dtype=np.int64)
    if not values.size:
        return []
    breaks = np.flatnonzero(np.diff(values) > 1)
    first = np.concatenate([[0], breaks + 1])
    last = np.concatenate([breaks, [values.size - 1]])
    return [(int(values[a]), int(values[b])) for a, b in zip(first, last, strict=True)]
