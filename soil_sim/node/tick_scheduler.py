"""TickScheduler: when the wall clock asks for the next tick in real time."""

from __future__ import annotations

import math

__all__ = ["LATE_FRACTION", "TickScheduler"]

LATE_FRACTION = 0.5
"""A tick done later than this after its time, in parts of its length, was late.

Less is jitter, of timers and of processes that share a processor, and is gone by the next tick.
"""

_MAX_LAG = 0.5
"""Lag [s] from which the schedule is moved instead of caught up with: the process was stopped, or
the host is too slow for real time."""


class TickScheduler:
    """A schedule of ticks by the wall clock, kept by a timer that fires once a tick.

    The timer may be served late, or leave a call out: what counts is when each call was due.

    Attributes:
        late: ticks that were not done when their time came.
        slips: times the schedule had to be moved.
    """

    def __init__(self, period: float) -> None:
        """`period` is the length of a tick [s]."""
        self._period = period
        self._start_time: float | None = None
        self._num_done = 0
        self._num_due = 0
        self.num_late_ticks = 0
        self.num_reschedules = 0

    def stop(self) -> None:
        """Forget the schedule; it begins anew with the timer's next call."""
        self._start_time = None
        self._num_due = self._num_done

    def on_timer(self, scheduled: float) -> None:
        """The timer fires.

        Args:
            scheduled: when it was to fire [s], a monotonic wall clock. Served late, the first call
                would shift the schedule against the timer, and all ticks with it.
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
        """Whether the next tick's time has come."""
        return self._num_done < self._num_due

    @property
    def is_overdue(self) -> bool:
        """Whether the time of the tick after it has come, too."""
        return self._num_done + 1 < self._num_due

    def mark_done(self, now: float) -> None:
        """Note that the tick that was due is done."""
        assert self._start_time is not None, "a tick that is done was due"
        self._num_done += 1
        if now - (self._start_time + self._num_done * self._period) > LATE_FRACTION * self._period:
            self.num_late_ticks += 1
