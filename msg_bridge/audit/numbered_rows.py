"""Numbered rows as a bag holds them: put in order, each once, and what is missing among them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.messages import STREAM_DTYPE, RowRange, Stream
from msg_bridge.contract.rows import Rows, empty_rows

__all__ = ["NumberedRows", "Spans", "contiguous_ranges", "order_rows"]

Numbers = NDArray[np.int64]

_MODULUS = 2**32


@dataclass(frozen=True)
class NumberedRows:
    """Rows of one stream.

    Attributes:
        numbers: of the rows, rising; whole numbers, where the rows' `seq` is modulo 2**32.
        rows: the rows.
        repeats: how many more came with a number that was had, and the same content.
        conflicts: numbers that came with more than one content.
    """

    numbers: Numbers
    rows: Rows
    duplicates: int
    conflicts: Numbers

    def count_through(self, last: Numbers) -> Numbers:
        """How many rows have a number up to each of `last`."""
        return np.searchsorted(self.numbers, last, side="right")


def order_rows(stream: Stream, chunks: Sequence[Rows], first: int | None) -> NumberedRows:
    """Put rows in order.

    Args:
        stream: what they are.
        chunks: as they came.
        first: number of some early row, from a header; None if there is no header.
    """
    rows = np.concatenate([empty_rows(STREAM_DTYPE[stream]), *chunks])
    seq = rows["seq"].astype(np.int64)
    if not seq.size:
        return NumberedRows(seq, rows, 0, seq)
    half = _MODULUS // 2
    # From each row to the next it is never half the numbers there are, forward or back.
    steps = (np.diff(seq) + half) % _MODULUS - half
    numbers = seq[0] + np.concatenate([[0], np.cumsum(steps)])
    if first is not None:
        numbers += round((first - int(numbers.min())) / _MODULUS) * _MODULUS
    if (np.diff(numbers) > 0).all():
        return NumberedRows(numbers, rows, 0, numbers[:0])
    order = np.argsort(numbers, kind="stable")
    numbers, rows = numbers[order], rows[order]
    again = np.concatenate([[False], numbers[1:] == numbers[:-1]])
    first_of = np.flatnonzero(~again)[np.cumsum(~again) - 1]
    content = np.ascontiguousarray(rows).view(np.uint8).reshape(rows.size, -1)
    differs = np.zeros(rows.size, dtype=np.bool_)
    differs[again] = (content[again] != content[first_of[again]]).any(axis=1)
    conflicts = np.unique(numbers[differs])
    return NumberedRows(
        numbers[~again], rows[~again], int(again.sum()) - int(differs.sum()), conflicts
    )


@dataclass(frozen=True)
class Spans:
    """The ranges of rows that headers count, one for each header, in order.

    Attributes:
        ticks: of the headers, shape (n,), rising.
        first, last: number of each one's first and last row; last = first - 1 if there is none.
    """

    ticks: Numbers
    first: Numbers
    last: Numbers

    @classmethod
    def of(cls, ticks: Iterable[int], ranges: Iterable[RowRange]) -> Spans:
        """From headers' ticks and ranges."""
        ranges = list(ranges)
        return cls(
            np.array(list(ticks), dtype=np.int64),
            np.array([each.first for each in ranges], dtype=np.int64),
            np.array([each.last for each in ranges], dtype=np.int64),
        )

    @property
    def total(self) -> int:
        """How many rows they count."""
        return int((self.last - self.first + 1).sum())

    def tick_of(self, numbers: Numbers) -> Numbers:
        """The tick of the first header that ends with each row or after it; the last one's else."""
        index = np.searchsorted(self.last, numbers, side="left")
        return self.ticks[np.minimum(index, self.ticks.size - 1)]

    def lacking(self, stream: NumberedRows) -> NDArray[np.bool_]:
        """Which headers count rows that are not there."""
        there = stream.count_through(self.last) - stream.count_through(self.first - 1)
        return np.asarray(there < self.last - self.first + 1)

    def discontinuities(self) -> NDArray[np.intp]:
        """Indices of headers that do not go on where the header of the tick before ended."""
        follows = self.ticks[1:] == self.ticks[:-1] + 1
        return np.flatnonzero(follows & (self.first[1:] != self.last[:-1] + 1)) + 1

    def missing(self, stream: NumberedRows) -> list[tuple[int, int]]:
        """Missing rows among those counted, as (first, last) numbers of each gap.

        Rows between two headers, of headers that are missing themselves, are counted too.
        """
        if not self.ticks.size or self.last[-1] < self.first[0]:
            return []
        low, high = int(self.first[0]), int(self.last[-1])
        here = stream.numbers[(stream.numbers >= low) & (stream.numbers <= high)]
        edges = np.concatenate([[low - 1], here, [high + 1]])
        before = np.flatnonzero(np.diff(edges) > 1)
        return [(int(edges[k]) + 1, int(edges[k + 1]) - 1) for k in before]


def contiguous_ranges(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Rising whole numbers as (first, last) of each run without a gap."""
    values = np.asarray(numbers, dtype=np.int64)
    if not values.size:
        return []
    breaks = np.flatnonzero(np.diff(values) > 1)
    first = np.concatenate([[0], breaks + 1])
    last = np.concatenate([breaks, [values.size - 1]])
    return [(int(values[a]), int(values[b])) for a, b in zip(first, last, strict=True)]
