"""Moving the tool along way points, as a steady hand would.

A set point travels along the way, and the joints are driven after it by velocity commands, the
only thing the machine takes. Where the machine cannot keep up, the set point waits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Motion", "Target", "servo"]

_GAIN = 4.0
"""Joint velocity for a joint error [1/s]."""

_LAG = 0.12
"""Joint error at which the set point waits [rad]."""


@dataclass(frozen=True)
class Target:
    """Joints to be in, and how long to take from the one before.

    Attributes:
        joints: swing, boom, arm, bucket [rad], shape (4,).
        duration: [s].
    """

    joints: NDArray[np.float64]
    duration: float


class Motion:
    """A set point on its way through targets; smooth at the ends, steady between."""

    def __init__(self, start: NDArray[np.float64], targets: Sequence[Target]) -> None:
        """
        Args:
            start: joints now [rad], shape (4,).
            targets: in order, at least one.
        """
        self._joints = np.vstack([start, *(target.joints for target in targets)])
        self._times = np.cumsum([0.0, *(max(target.duration, 1e-3) for target in targets)])
        self._time = 0.0

    @property
    def done(self) -> bool:
        """Whether the set point has reached the last target."""
        return self._time >= self._times[-1]

    def advance(self, joints: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
        """Move the set point on by `dt` [s] and return the joint velocities to command [rad/s].

        Args:
            joints: as measured [rad], shape (4,).
            dt: length of the tick [s].
        """
        now = self._at(self._time)
        lag = float(np.abs(now - joints).max())
        rate = max(0.0, 1.0 - max(0.0, lag - 0.5 * _LAG) / (0.5 * _LAG))
        self._time = min(self._time + rate * dt, float(self._times[-1]))
        following = self._at(self._time)
        return np.asarray((following - now) / dt + servo(joints, following), dtype=np.float64)

    def _at(self, time: float) -> NDArray[np.float64]:
        """Joints of the set point; the whole way is eased in and out."""
        total = float(self._times[-1])
        ease = min(0.5, 0.25 * total)
        t = _eased(time, total, ease)
        return np.array([np.interp(t, self._times, column) for column in self._joints.T])


def servo(joints: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Velocities that take the joints to where they are wanted [rad/s]."""
    return np.asarray(_GAIN * (wanted - joints), dtype=np.float64)


def _eased(time: float, total: float, ease: float) -> float:
    """Way time for a time: accelerates over `ease`, then runs steadily, and slows down again.

    Runs from 0 to `total` in `total` seconds; the steady rate is a little above 1.
    """
    rate = total / (total - ease)
    if time < ease:
        return 0.5 * rate * time * time / ease
    if time > total - ease:
        rest = total - time
        return total - 0.5 * rate * rest * rest / ease
    return rate * (time - 0.5 * ease)
