"""The table of near pairs: what `neighbours` fills and `contacts` reads."""

from __future__ import annotations

import numpy as np

__all__ = ["PairTable"]


class PairTable:
    """Listed pairs and their contact history.

    Attributes:
        first, second: rows of each pair, uint32.
        touching, spring: history, see `forces.pair_forces`.
        begin, end: pairs of each row that is `first`, shape (n,).
        bounds: of its parts, see `parts.partition_pairs`.
        count: number of pairs.
    """

    def __init__(self, capacity: int, rows: int) -> None:
        self.first = np.zeros(capacity, np.uint32)
        self.second = np.zeros(capacity, np.uint32)
        self.contact_flag = np.zeros(capacity, np.uint8)
        self.spring = np.zeros((capacity, 3), np.float32)
        self.begin = np.zeros(rows, np.int64)
        self.end = np.zeros(rows, np.int64)
        self.bounds = np.zeros(2, np.int64)
        self.count = 0

    @property
    def is_partitioned(self) -> bool:
        """Whether there is more than one region for several threads to work in."""
        return len(self.bounds) > 2
