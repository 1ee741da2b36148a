"""Schedule ticks by the wall clock in real time."""

from __future__ import annotations

import math

__all__ = ["LATE_FRACTION", "TickScheduler"]

LATE_FRACTION = 0.5
"""Delay above which a tick counts as late, as a fraction of its length.

Smaller delays are jitter of timers and of processes that share a processor.
"""

_MAX_LAG = 0.5
"""Lag [s] above which the schedule is moved instead of caught up with: the process was stopped, or
the computer is too slow for real time."""


class TickScheduler:
    """Schedule of ticks by the wall clock, driven by a timer with the period of a tick.

    The timer may fire late or skip a call: the scheduled time of each call counts.

    Attributes:
        num_late_ticks: number of ticks that were not done in time.
        num_reschedules: number of times that the schedule was moved.
    """

    def __init__(self, period: float) -> None:
        """Create a schedule of ticks of length `period` [s]."""
        self._period = period
        self._start_time: float | None = None
        self._num_done = 0
        self._num_due = 0
        self.num_late_ticks = 0
        self.num_reschedules = 0

    def stop(self) -> None:
        """Discard the schedule; the next call of the timer starts a new one."""
        self._start_time = None
        self._num_due = self._num_done

    def on_timer(self, scheduled: float) -> None:
        """Handle a call of the timer.

        Args:
            scheduled: time at which it was due [s], monotonic wall clock. With the actual time, a
                first call that is late would shift the whole schedule against the timer.
        """
        if self._start_time is None:
            self._start_time = scheduled - self._num_done * self._period
        self._num_due = math.floor((scheduled - self._start_time) / self._period + 0.5)
        behind = self._num_due - self._num_done
        if behind * self._period > _MAX_LAG:
            self._start_time += (behind - 1) * self._period
            self._num_due = self._num_done + 1
            self.num_reschedules += 1

    @property
    def is_due(self) -> bool:
        """Whether the next tick is due."""
        return self._num_done < self._num_due

    @property
    def is_overdue(self) -> bool:
        """Whether the tick after the next one is due as well."""
        return self._num_done + 1 < self._num_due

    def mark_done(self, now: float) -> None:
        """Record that the tick that was due is done at `now` [s]."""
        assert self._start_time is not None, "no tick was due"
        self._num_done += 1
        if now - (self._start_time + self._num_done * self._period) > LATE_FRACTION * self._period:
            self.num_late_ticks += 1
