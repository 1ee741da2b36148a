"""Rows that arrived before rows with smaller numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.messages import RowRange
from msg_bridge.contract.rows import Rows, empty_rows

__all__ = ["MAX_ROWS_AHEAD", "ReorderBuffer"]

MAX_ROWS_AHEAD = 2**17
"""Number of rows from the first missing one on that are kept; those beyond are requested again.

It bounds memory and the time to add a message for any numbers that a publisher sends.
"""

_MIN_CAPACITY = 1024
"""Minimum number of slots that are allocated."""


class ReorderBuffer:
    """Rows beyond a gap, each once: the row with number `first + k` is in slot `k`.

    Adding rows takes a time in proportion to their number, not to that of the rows kept.
    """

    def __init__(self, dtype: np.dtype[np.void], first: int) -> None:
        """
        Args:
            dtype: dtype of the rows.
            first: number of the first missing row.
        """
        self._dtype = dtype
        self._first = first
        self._count = 0
        self._is_present: NDArray[np.bool_] = np.zeros(0, dtype=np.bool_)  # by slot
        self._rows = empty_rows(dtype)

    def __len__(self) -> int:
        return self._count

    def add(self, numbers: NDArray[np.int64], rows: Rows) -> int:
        """Add rows with their numbers, in any order; of rows with the same number the first counts.

        Rows before the first missing one, and `MAX_ROWS_AHEAD` or more beyond it, are dropped.

        Returns:
            The number of new rows.
        """
        slots, index = np.unique(numbers - self._first, return_index=True)
        begin, end = np.searchsorted(slots, (0, MAX_ROWS_AHEAD))
        slots, index = slots[begin:end], index[begin:end]
        if slots.size == 0:
            return 0
        if slots[-1] >= self._is_present.size:
            self._allocate(int(slots[-1]) + 1)
        is_new = ~self._is_present[slots]
        slots, index = slots[is_new], index[is_new]
        self._rows[slots] = rows[index]
        self._is_present[slots] = True
        self._count += slots.size
        return int(slots.size)

    def pop_contiguous(self, first: int) -> Rows:
        """Remove and return the rows from number `first` up to the next gap; drop older ones.

        The row after them is the first missing one then.

        Args:
            first: a number not less than that of the first missing row.
        """
        begin = min(first - self._first, self._is_present.size)
        later = self._is_present[begin:]
        num_rows = int(np.argmin(later)) if not later.all() else later.size
        removed = self._rows[begin : begin + num_rows].copy()
        end = begin + num_rows
        self._count -= int(np.count_nonzero(self._is_present[:end]))
        self._first = first + num_rows
        if self._count:
            self._is_present, self._rows = self._is_present[end:], self._rows[end:]
        else:
            self._is_present, self._rows = self._is_present[:0], empty_rows(self._dtype)
        return removed

    def missing(self, span: RowRange) -> list[RowRange]:
        """Return the gaps in a range, which begins with the first missing row or later."""
        begin = min(span.first - self._first, self._is_present.size)
        is_present = self._is_present[begin : begin + span.count]
        edges = np.flatnonzero(np.diff(is_present, prepend=True, append=True)).tolist()
        if is_present.size < span.count:  # all beyond the slots is missing
            if is_present.size and not is_present[-1]:
                edges[-1] = span.count
            else:
                edges += [is_present.size, span.count]
        return [
            RowRange(span.first + low, high - low)
            for low, high in zip(edges[0::2], edges[1::2], strict=True)
        ]

    def _allocate(self, num_slots: int) -> None:
        """Provide at least a number of slots; those that exist keep their rows."""
        capacity = min(max(_MIN_CAPACITY, 2 * num_slots), MAX_ROWS_AHEAD)
        old_rows, old_present = self._rows, self._is_present
        self._rows = empty_rows(self._dtype, capacity)
        self._is_present = np.zeros(capacity, dtype=np.bool_)
        self._rows[: old_rows.size] = old_rows
        self._is_present[: old_present.size] = old_present
