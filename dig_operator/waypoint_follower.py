"""WaypointFollower: joint velocities that move the bucket along waypoints.

Waypoints are poses of the bucket in the map frame. A set point travels along them. At every tick
the joint angles for the set point are solved for the present pose of the base, so that a base that
tilts under its load does not make the bucket dig deeper. The set point slows down and stops where
the machine cannot keep up.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dig_operator.bucket_kinematics import BucketKinematics, BucketPose
from dig_operator.observation import Observation

__all__ = ["MAX_JOINT_LAG", "Waypoint", "WaypointFollower", "path_time_at"]

_TRACKING_GAIN = 4.0
"""Joint velocity over joint error [1/s]."""

MAX_JOINT_LAG = 0.12
"""Joint error at which the set point of a path through soil stops [rad]."""

_ACCELERATION_TIME = 0.5
"""Time of acceleration and of deceleration [s]; a shorter motion takes twice its path time."""

_MIN_DURATION = 1e-3
"""Minimum duration of the motion to a waypoint [s]."""


@dataclass(frozen=True)
class Waypoint:
    """A pose of the bucket, and the duration of the motion to it from the previous one [s]."""

    pose: BucketPose
    duration: float


class WaypointFollower:
    """A set point that travels along waypoints: eased at the ends, at constant rate between."""

    def __init__(
        self,
        start: BucketPose,
        waypoints: Sequence[Waypoint],
        *,
        max_joint_lag: float = MAX_JOINT_LAG,
    ) -> None:
        """
        Args:
            start: present pose of the bucket.
            waypoints: waypoints in order, at least one.
            max_joint_lag: joint error at which the set point stops [rad]; it slows down from half
                of that on.
        """
        self._max_joint_lag = max_joint_lag
        poses = np.array([start, *(waypoint.pose for waypoint in waypoints)])
        poses[:, 0] = np.unwrap(poses[:, 0])  # swing the short way
        durations = (max(waypoint.duration, _MIN_DURATION) for waypoint in waypoints)
        times = np.cumsum([0.0, *durations])
        # Lists, since the arrays are too small for numpy to pay at every tick.
        self._velocities = (np.diff(poses, axis=0) / np.diff(times)[:, None]).tolist()
        self._poses: list[list[float]] = poses.tolist()
        self._times: list[float] = times.tolist()
        self._path_time = self._times[-1]
        self._acceleration_time = min(_ACCELERATION_TIME, self._path_time)
        self._duration: float = self._path_time + self._acceleration_time
        self._time = 0.0
        self._set_point = self.set_point(0.0)

    @property
    def done(self) -> bool:
        """Whether the set point has reached the last waypoint."""
        return self._time >= self._duration

    def advance(
        self, observation: Observation, kinematics: BucketKinematics, dt: float
    ) -> NDArray[np.float64]:
        """Advance the set point by `dt` [s]; return the joint velocities to command [rad/s], (4,).

        Raises:
            ReachError: the machine cannot reach the set point.
        """
        joints: list[float] = observation.joints.tolist()
        target: list[float] = kinematics.joint_angles(observation, self._set_point).tolist()
        lag = max([abs(angle - joint) for angle, joint in zip(target, joints, strict=True)])
        rate = min(1.0, max(0.0, 2.0 - 2.0 * lag / self._max_joint_lag))
        self._time = min(self._time + rate * dt, self._duration)
        self._set_point = self.set_point(self._time)
        next_target: list[float] = kinematics.joint_angles(observation, self._set_point).tolist()
        return np.array(
            [
                (next_angle - angle) / dt + _TRACKING_GAIN * (next_angle - joint)
                for next_angle, angle, joint in zip(next_target, target, joints, strict=True)
            ]
        )

    def set_point(self, time: float) -> BucketPose:
        """Return the set point at a time since the start of an unhindered motion [s]."""
        path_time = path_time_at(time, self._path_time, self._acceleration_time)
        k = bisect_right(self._times, path_time) - 1
        if k == len(self._velocities):
            return BucketPose(*self._poses[-1])
        elapsed = path_time - self._times[k]
        pairs = zip(self._poses[k], self._velocities[k], strict=True)
        return BucketPose(*[x + velocity * elapsed for x, velocity in pairs])


def path_time_at(time: float, path_time: float, acceleration_time: float) -> float:
    """Return the path time [s] at a time [s] of a motion that starts and ends at rest.

    The path time grows from 0 to `path_time` in `path_time + acceleration_time`: its rate rises
    linearly to 1 during the acceleration time, and falls to 0 in the same way at the end.

    Args:
        time: time since the start [s].
        path_time: duration of the path at rate 1 [s].
        acceleration_time: duration of acceleration and of deceleration [s], at most `path_time`.
    """
    if time < acceleration_time:
        return 0.5 * time * time / acceleration_time
    if time > path_time:
        remaining = path_time + acceleration_time - time
        return path_time - 0.5 * remaining * remaining / acceleration_time
    return time - 0.5 * acceleration_time
