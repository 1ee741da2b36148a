"""Rows that have come before others that are still missing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.messages import RowRange
from msg_bridge.contract.rows import Rows, empty_rows, join_rows

__all__ = ["ReorderBuffer"]


class ReorderBuffer:
    """Rows beyond a gap, by number, each once."""

    def __init__(self, dtype: np.dtype[np.void]) -> None:
        """`dtype` is that of the rows."""
        self._dtype = dtype
        self._numbers: NDArray[np.int64] = np.zeros(0, dtype=np.int64)  # ascending
        self._rows = empty_rows(dtype)

    def __len__(self) -> int:
        return self._rows.size

    def add(self, numbers: NDArray[np.int64], rows: Rows) -> int:
        """Take rows with their numbers, in any order; of two with the same the first counts.

        Returns:
            How many were new.
        """
        before = len(self)
        self._numbers, where = np.unique(
            np.concatenate([self._numbers, numbers]), return_index=True
        )
        self._rows = join_rows([self._rows, rows], self._dtype)[where]
        return len(self) - before

    def pop_contiguous(self, first: int) -> Rows:
        """Take out the rows from number `first` on, before the next gap; older ones are dropped."""
        begin = int(np.searchsorted(self._numbers, first))
        # Numbers ascend: behind a gap none is where it would be without.
        in_place = self._numbers[begin:] == first + np.arange(len(self) - begin)
        end = begin + int(np.count_nonzero(in_place))
        taken = self._rows[begin:end].copy()
        self._numbers, self._rows = self._numbers[end:].copy(), self._rows[end:].copy()
        return taken

    def missing(self, span: RowRange) -> list[RowRange]:
        """Gaps in a range, as ranges."""
        begin, end = np.searchsorted(self._numbers, (span.first, span.last + 1))
        have = np.ones(span.count + 2, dtype=np.bool_)
        have[1:-1] = False
        have[self._numbers[begin:end] - span.first + 1] = True
        edges = np.flatnonzero(have[1:] != have[:-1]).tolist()
        return [
            RowRange(span.first + low, high - low)
            for low, high in zip(edges[0::2], edges[1::2], strict=True)
        ]
