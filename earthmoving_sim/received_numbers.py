"""Numbers of rows, by which each row of a bag counts once."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

__all__ = ["ReceivedNumbers"]


class ReceivedNumbers:
    """Numbers of the rows that were received, as disjoint intervals in ascending order.

    Rows that are sent again may arrive behind later ones, and are new if they were lost before.
    """

    def __init__(self) -> None:
        self._starts: list[int] = []
        self._ends: list[int] = []  # exclusive

    @property
    def first(self) -> int | None:
        """Smallest number; None without any."""
        return self._starts[0] if self._starts else None

    @property
    def num_missing(self) -> int:
        """How many numbers between the smallest and the largest one were not received."""
        return sum(start - end for start, end in zip(self._starts[1:], self._ends, strict=False))

    def add(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Add numbers; return which of them are new.

        Args:
            numbers: ascending numbers, shape (n,).
        """
        if not numbers.size:
            return np.zeros(0, dtype=bool)
        first, last = int(numbers[0]), int(numbers[-1])
        is_run = last - first == numbers.size - 1 and bool((np.diff(numbers) == 1).all())
        if is_run and (not self._ends or first >= self._ends[-1]):
            self._insert(first, last + 1)
            return np.ones(numbers.size, dtype=bool)
        return np.array([self._add_one(number) for number in numbers.tolist()])

    def _add_one(self, number: int) -> bool:
        place = bisect_right(self._starts, number) - 1
        if place >= 0 and number < self._ends[place]:
            return False
        self._insert(number, number + 1)
        return True

    def _insert(self, start: int, end: int) -> None:
        """Insert an interval that overlaps no other, and merge it with its neighbours."""
        place = bisect_right(self._starts, start)
        if place and self._ends[place - 1] == start:
            place -= 1
            self._ends[place] = end
        else:
            self._starts.insert(place, start)
            self._ends.insert(place, end)
        if place + 1 < len(self._starts) and self._starts[place + 1] == end:
            self._ends[place] = self._ends.pop(place + 1)
            del self._starts[place + 1]
