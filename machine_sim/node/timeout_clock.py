"""Clock by which commands time out in real time."""

from __future__ import annotations

__all__ = ["MAX_COMMAND_LEAD", "STANDSTILL_TIME", "TimeoutClock"]

MAX_COMMAND_LEAD = 0.1
"""Maximum time by which the clock is ahead of a slow simulation [s]."""

STANDSTILL_TIME = 1.0
"""Time between two ticks above which time stood still [s]: commands from before are too old."""


class TimeoutClock:
    """Wall clock that slows down with simulation time.

    A command that is not renewed must stop the machine, by the wall clock of the person or program
    that commands it. Where simulation time is slow, a program that runs by it renews its commands
    less often by the wall clock, and the machine moves in slow motion. So this clock follows the
    wall clock, but is at most `MAX_COMMAND_LEAD` faster than simulation time: the distance that a
    machine moves after the last command is the same on a slow computer. After a pause or another
    standstill all of the time counts, so that no command from before moves the machine.

    """

    def __init__(self) -> None:
        self._time = 0.0  # at the beginning of the last tick
        self._last: tuple[float, float] | None = None  # wall clock, simulation time
        self._lead = 0.0  # over simulation time

    def now(self, wall: float) -> float:
        """Return the time of a command that arrives now [s]: at most that of the next tick.

        Args:
            wall: monotonic wall clock [s].
        """
        elapsed = 0.0 if self._last is None else wall - self._last[0]
        return self._time + (elapsed if elapsed > STANDSTILL_TIME else 0.0)

    def tick(self, wall: float, sim_time: float) -> float:
        """Return the time at the beginning of a tick [s].

        Args:
            wall: monotonic wall clock [s].
            sim_time: simulation time [s], which increases.
        """
        last, self._last = self._last, (wall, sim_time)
        if last is None:
            return self._time
        elapsed = wall - last[0]
        if elapsed > STANDSTILL_TIME:
            self._lead = 0.0
        else:
            lead = max(0.0, self._lead + elapsed - (sim_time - last[1]))
            self._lead = min(lead, MAX_COMMAND_LEAD)
            elapsed -= lead - self._lead
        self._time += elapsed
        return self._time
