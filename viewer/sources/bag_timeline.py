"""BagTimeline: the position in a bag in simulated time, over the log time of its messages."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["BagTimeline"]

_NANO = 1e-9

_EPSILON = 1e-6
"""Time by which positions may be rounded [s], less than a tick."""


class BagTimeline:
    """Simulated time since the first tick, over all runs of a bag [s].

    A bag of a run in lockstep has more or less than a second of simulated time in a second of log
    time, and a pause has none. After a reset the simulated time begins at 0 again, and the position
    continues.

    Attributes:
        duration: position of the last tick [s].
    """

    def __init__(self, log_times: NDArray[np.int64], sim_times: NDArray[np.float64]) -> None:
        """
        Args:
            log_times: log time of each tick [ns], ascending, not empty.
            sim_times: simulated time at its end [s].
        """
        steps = np.maximum(np.diff(sim_times), 0.0)
        self._positions = np.concatenate([[0.0], np.cumsum(steps)])
        self._log_times = log_times
        self.duration = float(self._positions[-1])

    @classmethod
    def of_log_times(cls, first: int, last: int) -> BagTimeline:
        """Return the timeline of a bag without ticks, from its first and last log time [ns]."""
        times = np.array([first, max(last, first)], dtype=np.int64)
        return cls(times, np.array((times - first) * _NANO))

    def log_time(self, position: float) -> float:
        """Return the log time of a position [ns]; infinite at the end, so that nothing follows."""
        position += _EPSILON
        if position >= self.duration:
            return np.inf
        after = int(np.searchsorted(self._positions, position, side="right"))
        before = after - 1
        if before < 0:
            return float(self._log_times[0])
        low, high = self._positions[before], self._positions[after]
        share = (position - low) / (high - low)
        begin, end = int(self._log_times[before]), int(self._log_times[after])
        return float(begin + share * (end - begin))

    def position(self, log_time: int) -> float:
        """Return the position of a log time [s]."""
        return float(np.interp(log_time, self._log_times, self._positions))
