"""Cycles of a machine by its payload: each time that it was loaded and then emptied."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

__all__ = ["LOADED", "PayloadCycle", "find_cycles"]

LOADED = 0.3
_EMPTY = 0.15
"""Fractions of the largest payload above which a machine is loaded, and below which it is empty.

What remains in a bucket after a dump is less, and what spills on the way leaves it loaded.
"""


class PayloadCycle(NamedTuple):
    """A cycle.

    Attributes:
        end: time at which the machine was empty again [s].
        volume: largest payload of the cycle minus that at its end [m^3 bank].
        duration: time since the end of the cycle before; of the first, since the begin [s].
    """

    end: float
    volume: float
    duration: float


def find_cycles(samples: Iterable[tuple[float, float]]) -> list[PayloadCycle]:
    """Return the completed cycles.

    Args:
        samples: time [s] and payload [m^3 bank], in the order of time.
    """
    samples = list(samples)
    largest = max((volume for _, volume in samples), default=0.0)
    if largest <= 0.0:
        return []
    cycles: list[PayloadCycle] = []
    last_end, peak = samples[0][0], 0.0
    for time, volume in samples:
        if volume > LOADED * largest or peak:
            peak = max(peak, volume)
        if peak and volume < _EMPTY * largest:
            cycles.append(PayloadCycle(time, peak - volume, time - last_end))
            last_end, peak = time, 0.0
    return cycles
