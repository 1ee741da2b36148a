"""The way of a body in bounded memory."""

from __future__ import annotations

import math
from array import array

import numpy as np
from numpy.typing import NDArray

__all__ = ["Way"]

_CAPACITY = 20_000
"""Number of positions above which every second one is left out."""


class Way:
    """Positions of a body. Its length is that of all positions, of which a part is kept.

    Attributes:
        length: way so far [m].
    """

    def __init__(self, capacity: int = _CAPACITY) -> None:
        """
        Args:
            capacity: maximum number of positions that are kept.
        """
        self.length = 0.0
        self._capacity = capacity
        self._x, self._y = array("d"), array("d")
        self._last: tuple[float, float] | None = None
        self._count = 0
        self._interval = 1  # number of positions of which one is kept

    def __len__(self) -> int:
        return self._count

    def add(self, x: float, y: float) -> None:
        """Add a position [m]; one that is not finite is left out."""
        if not (math.isfinite(x) and math.isfinite(y)):
            return
        if self._last is not None:
            self.length += math.hypot(x - self._last[0], y - self._last[1])
        self._last = (x, y)
        if self._count % self._interval == 0:
            self._x.append(x)
            self._y.append(y)
        self._count += 1
        if len(self._x) > self._capacity:
            self._x, self._y = self._x[::2], self._y[::2]
            self._interval *= 2

    @property
    def positions(self) -> NDArray[np.float64]:
        """The positions that are kept and the last one [m], shape (n, 2)."""
        kept = np.column_stack((self._x, self._y))
        return kept if self._last is None else np.vstack((kept, self._last))
