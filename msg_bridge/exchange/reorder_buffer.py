"""Rows that arrived before rows with smaller numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.messages import RowRange
from msg_bridge.contract.rows import Rows, empty_rows, join_rows

__all__ = ["ReorderBuffer"]


class ReorderBuffer:
    """Rows beyond a gap, each once, ordered by number."""

    def __init__(self, dtype: np.dtype[np.void]) -> None:
        """
        Args:
            dtype: dtype of the rows.
        """
        self._dtype = dtype
        self._numbers: NDArray[np.int64] = np.zeros(0, dtype=np.int64)  # ascending
        self._rows = empty_rows(dtype)

    def __len__(self) -> int:
        return self._rows.size

    def add(self, numbers: NDArray[np.int64], rows: Rows) -> int:
        """Add rows with their numbers, in any order; of rows with the same number the first counts.

        Returns:
            The number of new rows.
        """
        size_before = len(self)
        self._numbers, index = np.unique(
            np.concatenate([self._numbers, numbers]), return_index=True
        )
        self._rows = join_rows([self._rows, rows], self._dtype)[index]
        return len(self) - size_before

    def pop_contiguous(self, first: int) -> Rows:
        """Remove and return the rows from number `first` up to the next gap; drop older ones."""
        begin = int(np.searchsorted(self._numbers, first))
        # The numbers ascend: beyond a gap none equals its index plus `first`.
        is_contiguous = self._numbers[begin:] == first + np.arange(len(self) - begin)
        end = begin + int(np.count_nonzero(is_contiguous))
        removed = self._rows[begin:end].copy()
        self._numbers, self._rows = self._numbers[end:].copy(), self._rows[end:].copy()
        return removed

    def missing(self, span: RowRange) -> list[RowRange]:
        """Return the gaps in a range."""
        begin, end = np.searchsorted(self._numbers, (span.first, span.last + 1))
        is_present = np.ones(span.count + 2, dtype=np.bool_)
        is_present[1:-1] = False
        is_present[self._numbers[begin:end] - span.first + 1] = True
        edges = np.flatnonzero(is_present[1:] != is_present[:-1]).tolist()
        return [
            RowRange(span.first + low, high - low)
            for low, high in zip(edges[0::2], edges[1::2], strict=True)
        ]
