"""Real-time factor and load of a node, and when they count as overload.

Independent of ROS and of clocks: the caller passes the time.
"""

from __future__ import annotations

from typing import NamedTuple

from msg_bridge.nodes.diagnostics import Level

__all__ = [
    "ERROR_FRACTION",
    "MIN_OVERLOAD_TIME",
    "OVERLOAD_CONDITION",
    "WARN_FRACTION",
    "LoadMeter",
    "OverloadMonitor",
    "TickLoad",
    "overload_remedy",
]

WARN_FRACTION = 0.95
"""Fraction of real time below which a node is overloaded."""

ERROR_FRACTION = 0.5
"""Fraction of real time below which a node is severely overloaded."""

MIN_OVERLOAD_TIME = 2.0
"""Wall time for which a fraction must be too low before it is reported [s]."""

OVERLOAD_CONDITION = "overload"
"""Condition, in the diagnostics of a node, of being slower than real time."""


def overload_remedy(*, has_particles: bool) -> str:
    """Return what the user can change, for the report of an overload.

    Args:
        has_particles: whether there are particles in the run; else fewer would not help.
    """
    fewer = "fewer particles (a larger particles.nominal_volume), " if has_particles else ""
    return f"use {fewer}fewer nodes on this computer, a longer tick_period, or sync: lockstep"


class TickLoad(NamedTuple):
    """Computing time of ticks over the tick period.

    Attributes:
        mean: mean of the ticks; above 1 the node is too slow for real time.
        maximum: maximum of the ticks.
        num_ticks: number of ticks.
    """

    mean: float
    maximum: float
    num_ticks: int


class LoadMeter:
    """Computing times of ticks between two calls of `take`."""

    def __init__(self) -> None:
        self._total = self._max = 0.0
        self._num_ticks = 0

    def record(self, duration: float) -> None:
        """Record the wall time for which a tick was computed [s]."""
        self._total += duration
        self._max = max(self._max, duration)
        self._num_ticks += 1

    def take(self, tick_period: float) -> TickLoad:
        """Return the load of the ticks recorded since the last call; zeros without any."""
        count = self._num_ticks
        load = TickLoad(self._total / max(count, 1) / tick_period, self._max / tick_period, count)
        self._total, self._max, self._num_ticks = 0.0, 0.0, 0
        return load


class OverloadMonitor:
    """Compares the progress of a quantity with the progress that is expected of it.

    Of simulation time with wall time it gives the real-time factor.

    Attributes:
        fraction: progress over expected progress between the last two calls of `update`; 0 before.
    """

    def __init__(self, *, resolution: float) -> None:
        """
        Args:
            resolution: step of the progress, such as the tick period; one step less than expected
                is not a deviation.
        """
        self.fraction = 0.0
        self._resolution = resolution
        self._last: tuple[float, float, float] | None = None  # now, progress, expected
        self._low_since: dict[float, float | None] = {WARN_FRACTION: None, ERROR_FRACTION: None}
        self._now = 0.0

    def restart(self) -> None:
        """Begin a new comparison at the next `update`."""
        self._last = None
        self._low_since = dict.fromkeys(self._low_since)

    def update(self, now: float, progress: float, expected: float, *, judge: bool) -> None:
        """Compare the progress since the last call.

        Args:
            now: monotonic wall clock [s].
            progress: present value, which increases by `expected` per expected progress.
            expected: present value of what it is compared with.
            judge: whether the progress since the last call may count as overload; not while the
                run is paused, for instance.
        """
        last, self._last, self._now = self._last, (now, progress, expected), now
        if last is None:
            self.fraction = 0.0
            return
        done, due = progress - last[1], expected - last[2]
        self.fraction = done / due if due > 0.0 else 0.0
        for limit, since in self._low_since.items():
            is_low = judge and done + self._resolution < limit * due
            self._low_since[limit] = (last[0] if since is None else since) if is_low else None

    @property
    def low_time(self) -> float:
        """Wall time for which the fraction has been below `WARN_FRACTION` [s]."""
        since = self._low_since[WARN_FRACTION]
        return 0.0 if since is None else self._now - since

    @property
    def level(self) -> Level:
        """OK, or WARN or ERROR after `MIN_OVERLOAD_TIME` below the fraction of that level."""
        for limit, level in ((ERROR_FRACTION, Level.ERROR), (WARN_FRACTION, Level.WARN)):
            since = self._low_since[limit]
            if since is not None and self._now - since >= MIN_OVERLOAD_TIME:
                return level
        return Level.OK
