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

from dig_operator.bucket_kinematics import BucketKinematics, BucketPose
from dig_operator.observation import Observation

__all__ = ["Waypoint", "WaypointFollower"]

_TRACKING_GAIN = 4.0
"""Joint velocity for a joint error [1/s]."""

_MAX_JOINT_LAG = 0.12
"""Joint error at which the set point waits [rad]."""

_ACCELERATION_TIME = 1.0
"""Time over which a motion speeds up, and slows down [s]; a shorter motion takes twice as long."""


@dataclass(frozen=True)
class Waypoint:
    """A place of the bucket, and how long to take to it from the one before [s]."""

    pose: BucketPose
    duration: float


class WaypointFollower:
    """A set point on its way through targets; smooth at the ends, steady between."""

    def __init__(self, start: BucketPose, targets: Sequence[Waypoint]) -> None:
        """
        Args:
            start: where the bucket is.
            targets: in order, at least one.
        """
        places = np.array([start, *(target.pose for target in targets)])
        places[:, 0] = np.unwrap(places[:, 0])  # the short way around
        times = np.cumsum([0.0, *(max(target.duration, 1e-3) for target in targets)])
        # Plain numbers: what is looked up at every tick is too small for arrays.
        self._velocities = (np.diff(places, axis=0) / np.diff(times)[:, None]).tolist()
        self._num_poses: list[list[float]] = places.tolist()
        self._times: list[float] = times.tolist()
        self._path_time = self._times[-1]
        self._acceleration_time = min(_ACCELERATION_TIME, self._path_time)
        self._duration: float = self._path_time + self._acceleration_time
        self._time = 0.0

    @property
    def done(self) -> bool:
        """Whether the set point has reached the last target."""
        return self._time >= self._duration

    def advance(
        self, observation: Observation, kinematics: BucketKinematics, dt: float
    ) -> NDArray[np.float64]:
        """Move the set point on by `dt` [s] and return the joint velocities to command [rad/s]."""
        now = kinematics.joint_angles(observation, self._set_point(self._time))
        lag = float(np.abs(now - observation.joints).max())
        rate = min(1.0, max(0.0, 2.0 - 2.0 * lag / _MAX_JOINT_LAG))
        self._time = min(self._time + rate * dt, self._duration)
        following = kinematics.joint_angles(observation, self._set_point(self._time))
        velocity = (following - now) / dt + _TRACKING_GAIN * (following - observation.joints)
        return np.asarray(velocity, dtype=np.float64)

    def _set_point(self, time: float) -> BucketPose:
        t = _path_time_at(time, self._path_time, self._acceleration_time)
        k = bisect_right(self._times, t) - 1
        if k == len(self._velocities):
            return BucketPose(*self._num_poses[-1])
        since = t - self._times[k]
        return BucketPose(
            *(
                x + rate * since
                for x, rate in zip(self._num_poses[k], self._velocities[k], strict=True)
            )
        )


def _path_time_at(time: float, way: float, ease: float) -> float:
    """Way time for a time: accelerates over `ease`, then runs at rate 1, and slows down again.

    Runs from 0 to `way` in `way + ease` seconds; `ease` is at most `way`.
    """
    if time < ease:
        return 0.5 * time * time / ease
    if time > way:
        rest = way + ease - time
        return way - 0.5 * rest * rest / ease
    return time - 0.5 * ease
