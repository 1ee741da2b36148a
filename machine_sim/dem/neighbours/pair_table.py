"""The table of neighbouring pairs, which `verlet_list` fills and `contacts` reads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import BoxedTable, box_table

__all__ = ["ListedPairs", "PairArrays", "PairTable"]


class PairArrays(NamedTuple):
    """Arrays of a `PairTable` for kernels; see there."""

    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    contact_flag: NDArray[np.uint8]
    spring: NDArray[np.float32]


class ListedPairs(NamedTuple):
    """A `PairTable` for kernels; see there."""

    arrays: PairArrays
    bounds: NDArray[np.int64]


class PairTable:
    """Listed pairs and their contact history.

    Attributes:
        first, second: rows of the particles of each pair, uint32, shape (capacity,).
        contact_flag: 1 for a pair in contact, whose `spring` is valid; else 0; or
            `history_transfer.BOTH_ASLEEP` for one that is no longer listed; uint8, shape
            (capacity,).
        spring: elongation of the tangential spring, map axes [m], float32, shape (capacity, 3).
        arrays: the four above, for kernels.
        bounds: first pair of each part of the list and the end, see `partition.partition_pairs`.
        boxed: `ListedPairs`, boxed.
        count: number of pairs.
    """

    def __init__(self, capacity: int) -> None:
        self.first = np.zeros(capacity, np.uint32)
        self.second = np.zeros(capacity, np.uint32)
        self.contact_flag = np.zeros(capacity, np.uint8)
        self.spring = np.zeros((capacity, 3), np.float32)
        self.arrays = PairArrays(self.first, self.second, self.contact_flag, self.spring)
        self.count = 0
        self._allocate_bounds(2)

    def _allocate_bounds(self, size: int) -> None:
        self.bounds = np.zeros(size, np.int64)
        self.boxed: BoxedTable = box_table(ListedPairs(self.arrays, self.bounds))

    def set_pairs(self, count: int, bounds: Sequence[int] | None = None) -> None:
        """Set the number of pairs, and the bounds of the parts of the list if it has several."""
        bounds = bounds or (0, count)
        if len(bounds) != len(self.bounds):
            self._allocate_bounds(len(bounds))
        self.bounds[:] = bounds
        self.count = count

    @property
    def is_partitioned(self) -> bool:
        """Whether the list has more than one region for several threads to work in."""
        return len(self.bounds) > 2
