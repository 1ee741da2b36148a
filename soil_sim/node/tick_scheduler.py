"""Schedule ticks by the wall clock in real time."""

from __future__ import annotations

import math

__all__ = ["LATE_FRACTION", "MAX_CATCH_UP_TIME", "TickScheduler"]

LATE_FRACTION = 0.5
"""Delay above which a tick counts as late, as a fraction of its length.

Smaller delays are jitter of timers and of processes that share a processor.
"""

MAX_CATCH_UP_TIME = 0.1
"""Maximum lag [s] that is caught up, but at least two ticks: short stalls, as for a garbage
collection or the publication of a map, do not slow the clock down.

Simulation time is never more than this behind its schedule. What a longer stall exceeds it by is
lost: the clock was slow, and does not run fast afterwards to make up for it.
"""


class TickScheduler:
    """Schedule of ticks by the wall clock, driven by a timer with the period of a tick.

    The timer may fire late or skip a call: the scheduled time of each call counts.

    Attributes:
        num_starts: number of times that a schedule was started: at first, and after each `stop`.
        num_late_ticks: number of ticks that began more than `LATE_FRACTION` of their length after
            their time.
        lost_time: sum of the times by which the schedule was moved [s], wall clock time in which
            simulation time stood still.
    """

    def __init__(self, period: float) -> None:
        """Create a schedule of ticks of length `period` [s]."""
        self._period = period
        self._max_ticks_behind = max(2, round(MAX_CATCH_UP_TIME / period))
        self._start_time: float | None = None
        self._num_done = 0
        self._num_due = 0
        self.num_starts = 0
        self.num_late_ticks = 0
        self.lost_time = 0.0
        self._max_delay = 0.0

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
            self.num_starts += 1
        self._num_due = math.floor((scheduled - self._start_time) / self._period + 0.5)
        excess = self._num_due - self._num_done - self._max_ticks_behind
        if excess > 0:
            self._start_time += excess * self._period
            self._num_due -= excess
            self.lost_time += excess * self._period

    @property
    def is_running(self) -> bool:
        """Whether there is a schedule: not before the first call of the timer, nor after `stop`."""
        return self._start_time is not None

    @property
    def is_due(self) -> bool:
        """Whether the next tick is due."""
        return self._num_done < self._num_due

    @property
    def is_overdue(self) -> bool:
        """Whether the tick after the next one is due as well."""
        return self._num_done + 1 < self._num_due

    def mark_done(self, now: float) -> bool:
        """Record that the tick that was due is done at `now` [s]; return whether it was late."""
        assert self._start_time is not None, "no tick was due"
        self._num_done += 1
        delay = now - (self._start_time + self._num_done * self._period)
        self._max_delay = max(self._max_delay, delay)
        is_late = delay > LATE_FRACTION * self._period
        self.num_late_ticks += is_late
        return is_late

    def take_max_delay(self) -> float:
        """Return the largest delay of a tick after its time since the last call [s]."""
        delay, self._max_delay = self._max_delay, 0.0
        return delay
