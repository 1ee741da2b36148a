"""Cycles of a machine by its payload: dig, lift, swing, dump and return.

A cycle ends when a payload above 30 % of the largest one falls below 15 %. Within it:

- dig: from the last time that the payload was below 5 % of the cycle's largest one, to the time at
  which it has 95 % of that;
- lift and swing: until the payload falls below 90 % of what is carried for the last time; the swing
  begins when the superstructure turns by more than 0.05 rad/s;
- dump: until the cycle ends.

What is carried is the median of the payload after the dig, where it is more than half of the
largest one: what spills when the tool is lifted is not moved. What is before the dig is the return
from the cycle before. For a dumper, dig is the loading, lift and swing are the haul.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.run_figures.payload_cycles import LOADED, find_cycles

__all__ = ["WorkCycle", "find_work_cycles"]

_EMPTY, _FILLED, _UNLOADING = 0.05, 0.95, 0.9
"""Fractions of the largest payload of a cycle, and of what is carried."""

_CARRIED = 0.5
"""Fraction of the largest payload of a cycle above which it counts for what is carried."""

_SWINGING = 0.05
"""Angular velocity from which on the superstructure swings [rad/s]."""


@dataclass(frozen=True)
class WorkCycle:
    """A cycle; times in [s], volumes in [m^3 bank].

    Attributes:
        start, end: begin of the return from the cycle before, and end of the dump.
        volume: what is carried minus what is left after the dump.
        return_time, dig_time, lift_time, swing_time, dump_time: durations of its parts; the swing
            is part of the lift if it is not recorded.
    """

    start: float
    end: float
    volume: float
    return_time: float
    dig_time: float
    lift_time: float
    swing_time: float
    dump_time: float

    @property
    def duration(self) -> float:
        """Time from the end of the cycle before to its own end [s]."""
        return self.end - self.start

    @property
    def productivity(self) -> float:
        """Volume per time [m^3/h]."""
        return 3600.0 * self.volume / self.duration if self.duration > 0.0 else 0.0


def find_work_cycles(
    times: NDArray[np.float64],
    payload: NDArray[np.float64],
    swing_times: NDArray[np.float64] | None = None,
    swing_speeds: NDArray[np.float64] | None = None,
) -> list[WorkCycle]:
    """Return the cycles that are recorded as a whole; with a load at the begin, one is not.

    Args:
        times, payload: samples of the payload [s], [m^3 bank], shape (n,), in the order of time.
        swing_times, swing_speeds: angular velocity of the superstructure [rad/s], shape (m,).
    """
    found = find_cycles(zip(times.tolist(), payload.tolist(), strict=True))
    if found and payload[0] > LOADED * payload.max():
        found = found[1:]
    ends = [each.end for each in found]
    cycles = []
    for each, next_end in zip(found, [*ends[1:], np.inf], strict=False):
        inside = (times >= each.end - each.duration) & (times <= each.end)
        if inside.sum() < 2:
            continue
        # A tool is emptied further when the cycle has ended by its payload.
        residual = float(payload[(times >= each.end) & (times < next_end)].min())
        cycles.append(_split(times[inside], payload[inside], residual, swing_times, swing_speeds))
    return cycles


def _split(
    times: NDArray[np.float64],
    payload: NDArray[np.float64],
    residual: float,
    swing_times: NDArray[np.float64] | None,
    swing_speeds: NDArray[np.float64] | None,
) -> WorkCycle:
    """Return the parts of one cycle from its samples, and the payload that is left after it."""
    start, end, largest = float(times[0]), float(times[-1]), float(payload.max())
    filled = int(np.argmax(payload >= _FILLED * largest))
    empty = np.flatnonzero(payload[:filled] <= _EMPTY * largest)
    dig = int(empty[-1]) if empty.size else 0
    after = payload[filled:]
    carried = float(np.median(after[after > _CARRIED * largest]))
    loaded = np.flatnonzero(payload >= _UNLOADING * carried)
    unloading = int(loaded[-1])
    dig_start, dig_end, dump_start = (float(times[k]) for k in (dig, filled, unloading))
    swing_start = dump_start
    if swing_times is not None and swing_speeds is not None:
        is_loaded = (swing_times >= dig_end) & (swing_times <= dump_start)
        turning = swing_times[is_loaded & (np.abs(swing_speeds) > _SWINGING)]
        if turning.size:
            swing_start = float(turning[0])
    return WorkCycle(
        start,
        end,
        carried - residual,
        return_time=dig_start - start,
        dig_time=dig_end - dig_start,
        lift_time=swing_start - dig_end,
        swing_time=dump_start - swing_start,
        dump_time=end - dump_start,
    )
