"""A value over time in bounded memory."""

from __future__ import annotations

import math
from array import array

import numpy as np
from numpy.typing import NDArray

__all__ = ["Trace"]

_CAPACITY = 20_000
"""Number of samples above which a trace is thinned out: more than a picture has pixels."""


class Trace:
    """Samples of a value. Of many, the minimum and the maximum of each interval are kept."""

    def __init__(self, capacity: int = _CAPACITY) -> None:
        """
        Args:
            capacity: maximum number of samples that are kept.
        """
        self._capacity = capacity
        self._times, self._values = array("d"), array("d")
        self._interval = 1  # number of samples of which two are kept
        self._pending: list[tuple[float, float]] = []

    def __len__(self) -> int:
        return len(self._times) + len(self._pending)

    def add(self, time: float, value: float) -> None:
        """Add a sample; values that are not finite are left out."""
        if not (math.isfinite(time) and math.isfinite(value)):
            return
        if self._interval == 1:
            self._times.append(time)
            self._values.append(value)
        else:
            self._pending.append((time, value))
            if len(self._pending) == self._interval:
                self._keep_extremes()
        if len(self._times) > self._capacity:
            self._thin_out()

    @property
    def times(self) -> NDArray[np.float64]:
        """Times [s], shape (n,)."""
        return np.array([*self._times, *(time for time, _ in self._pending)])

    @property
    def values(self) -> NDArray[np.float64]:
        """Values, shape (n,)."""
        return np.array([*self._values, *(value for _, value in self._pending)])

    def _keep_extremes(self) -> None:
        pending, self._pending = self._pending, []
        lowest = min(pending, key=lambda sample: sample[1])
        highest = max(pending, key=lambda sample: sample[1])
        for time, value in sorted({lowest, highest}):
            self._times.append(time)
            self._values.append(value)

    def _thin_out(self) -> None:
        samples = list(zip(self._times, self._values, strict=True))
        self._times, self._values = array("d"), array("d")
        self._interval = 4 if self._interval == 1 else 2 * self._interval
        for start in range(0, len(samples), 4):
            part = samples[start : start + 4]
            lowest = min(part, key=lambda sample: sample[1])
            highest = max(part, key=lambda sample: sample[1])
            for time, value in sorted({lowest, highest}):
                self._times.append(time)
                self._values.append(value)
