"""Pace: when the wall clock asks for the next tick in real time."""

from __future__ import annotations

import math

__all__ = ["LATE", "Pace"]

LATE = 0.5
"""A tick done later than this after its time, in parts of its length, was late.

Less is jitter, of timers and of processes that share a processor, and is gone by the next tick.
"""

_FURTHEST_BEHIND = 0.5
"""Lag [s] from which the schedule is moved instead of caught up with: the process was stopped, or
the host is too slow for real time."""


class Pace:
    """A schedule of ticks by the wall clock, kept by a timer that fires once a tick.

    The timer may be served late, or leave a call out: what counts is when each call was due.

    Attributes:
        late: ticks that were not done when their time came.
        slips: times the schedule had to be moved.
    """

    def __init__(self, period: float) -> None:
        """`period` is the length of a tick [s]."""
        self._period = period
        self._origin: float | None = None
        self._done = 0
        self._asked = 0
        self.late = 0
        self.slips = 0

    def stop(self) -> None:
        """Forget the schedule; it begins anew with the timer's next call."""
        self._origin = None
        self._asked = self._done

    def on_time(self, scheduled: float) -> None:
        """The timer fires.

        Args:
            scheduled: when it was to fire [s], a monotonic wall clock. Served late, the first call
                would shift the schedule against the timer, and all ticks with it.
        """
        if self._origin is None:
            self._origin = scheduled - self._done * self._period
        self._asked = math.floor((scheduled - self._origin) / self._period + 0.5)
        behind = self._asked - self._done
        if behind * self._period > _FURTHEST_BEHIND:
            self._origin += (behind - 1) * self._period
            self._asked = self._done + 1
            self.slips += 1

    @property
    def due(self) -> bool:
        """Whether the next tick's time has come."""
        return self._done < self._asked

    @property
    def overdue(self) -> bool:
        """Whether the time of the tick after it has come, too."""
        return self._done + 1 < self._asked

    def done(self, now: float) -> None:
        """Note that the tick that was due is done."""
        assert self._origin is not None, "a tick that is done was due"
        self._done += 1
        if now - (self._origin + self._done * self._period) > LATE * self._period:
            self.late += 1
