"""Moving the bucket along way points, as a steady hand would.

Way points are places of the bucket over the map. A set point travels along them; at every tick the
joint angles that put the bucket there are found anew for the machine as it stands now, so that a
base that tilts under its load does not dig deeper. Where the machine cannot keep up, the set point
waits.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.operator.arm import ArmPlane, Place
from machine_sim.operator.view import View

__all__ = ["Motion", "Target"]

_GAIN = 4.0
"""Joint velocity for a joint error [1/s]."""

_LAG = 0.12
"""Joint error at which the set point waits [rad]."""

_EASE = 1.0
"""Time over which a motion speeds up, and slows down [s]; a shorter motion takes twice as long."""


@dataclass(frozen=True)
class Target:
    """A place of the bucket, and how long to take to it from the one before [s]."""

    place: Place
    duration: float


class Motion:
    """A set point on its way through targets; smooth at the ends, steady between."""

    def __init__(self, start: Place, targets: Sequence[Target]) -> None:
        """
        Args:
            start: where the bucket is.
            targets: in order, at least one.
        """
        places = np.array([start, *(target.place for target in targets)])
        places[:, 0] = np.unwrap(places[:, 0])  # the short way around
        times = np.cumsum([0.0, *(max(target.duration, 1e-3) for target in targets)])
        # Plain numbers: what is looked up at every tick is too small for arrays.
        self._rates = (np.diff(places, axis=0) / np.diff(times)[:, None]).tolist()
        self._places: list[list[float]] = places.tolist()
        self._times: list[float] = times.tolist()
        self._way = self._times[-1]
        self._ease = min(_EASE, self._way)
        self._total: float = self._way + self._ease
        self._time = 0.0

    @property
    def done(self) -> bool:
        """Whether the set point has reached the last target."""
        return self._time >= self._total

    def advance(self, view: View, arm: ArmPlane, dt: float) -> NDArray[np.float64]:
        """Move the set point on by `dt` [s] and return the joint velocities to command [rad/s]."""
        now = arm.joints(view, self._at(self._time))
        lag = float(np.abs(now - view.joints).max())
        rate = min(1.0, max(0.0, 2.0 - 2.0 * lag / _LAG))
        self._time = min(self._time + rate * dt, self._total)
        following = arm.joints(view, self._at(self._time))
        velocity = (following - now) / dt + _GAIN * (following - view.joints)
        return np.asarray(velocity, dtype=np.float64)

    def _at(self, time: float) -> Place:
        t = _eased(time, self._way, self._ease)
        k = bisect_right(self._times, t) - 1
        if k == len(self._rates):
            return Place(*self._places[-1])
        since = t - self._times[k]
        return Place(
            *(x + rate * since for x, rate in zip(self._places[k], self._rates[k], strict=True))
        )


def _eased(time: float, way: float, ease: float) -> float:
    """Way time for a time: accelerates over `ease`, then runs at rate 1, and slows down again.

    Runs from 0 to `way` in `way + ease` seconds; `ease` is at most `way`.
    """
    if time < ease:
        return 0.5 * time * time / ease
    if time > way:
        rest = way + ease - time
        return way - 0.5 * rest * rest / ease
    return time - 0.5 * ease
