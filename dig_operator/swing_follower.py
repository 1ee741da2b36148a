"""SwingFollower: joint velocities that swing the bucket to a target and lift it on the way.

The upper body of an excavator has by far the largest inertia of its joints, and its drive the least
torque for it: it needs 1 to 2 s to reach its speed, and as long to stop. The swing therefore moves
as fast as it can still be stopped at the target, and the arm follows a path that depends on how far
the swing has come, and not on time. Where the arm lags behind, as before a high wall, the swing
slows down and stops.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dig_operator.bucket_kinematics import BucketKinematics, BucketPose
from dig_operator.observation import Observation

__all__ = ["SwingFollower"]

_GAIN = 4.0
"""Joint velocity over joint error near the target [1/s]."""

_DRIVE_DELAY = 0.15
"""Time by which the drives follow a command later [s]: that of valves, and of messages."""

_BRAKING_FRACTION = 0.7
"""Fraction of the maximum acceleration with which the swing is stopped; the rest is for a load and
an arm that make the upper body more inert."""

_MAX_ARM_LAG = 0.06
"""Error of boom or arm at which the swing stops [rad]; it slows down from half of that on."""

_MIN_ANGLE = 0.1
"""Swing angle below which the arm goes straight to the target [rad]."""

_MAX_FINAL_ERROR, _MAX_FINAL_SPEED = 0.03, 0.08
"""Error [rad] and speed [rad/s] of the joints below which the target is reached."""


class SwingFollower:
    """Moves the bucket along poses at equal steps of azimuth."""

    def __init__(
        self,
        poses: Sequence[BucketPose],
        *,
        swing_speed: float,
        max_joint_accelerations: Sequence[float],
    ) -> None:
        """
        Args:
            poses: poses at equal steps of azimuth from the start to the target, two or more.
            swing_speed: speed of the swing joint [rad/s].
            max_joint_accelerations: accelerations of swing, boom, arm and bucket that the commands
                may have [rad/s^2].
        """
        self._poses = np.array(poses)
        self._poses[:, 0] = np.unwrap(self._poses[:, 0])
        self._angle = float(self._poses[-1, 0] - self._poses[0, 0])
        self._swing_speed = swing_speed
        self._braking = 2.0 * _BRAKING_FRACTION * np.array(max_joint_accelerations)
        self._last_joints: NDArray[np.float64] | None = None
        self._is_done = False

    @property
    def done(self) -> bool:
        """Whether the bucket has reached the last pose."""
        return self._is_done

    def advance(
        self, observation: Observation, kinematics: BucketKinematics, dt: float
    ) -> NDArray[np.float64]:
        """Return the joint velocities to command for the next `dt` [s], [rad/s], shape (4,).

        Raises:
            ReachError: the machine cannot reach a pose of the path.
        """
        joints = observation.joints
        before = joints if self._last_joints is None else self._last_joints
        velocities = (joints - before) / dt
        self._last_joints = joints
        end = kinematics.joint_angles(observation, BucketPose(*self._poses[-1].tolist()))
        remaining = float(end[0] - joints[0])
        swing_rate = float(velocities[0])
        # The arm aims at where the swing is once the drives have followed and the error is gone.
        ahead = swing_rate * (_DRIVE_DELAY + 1.0 / _GAIN)
        pose = self._pose_with_remaining(remaining)
        next_pose = self._pose_with_remaining(remaining - ahead)
        # It rises early, but falls only behind what it has to clear.
        next_pose = next_pose._replace(height=max(pose.height, next_pose.height))
        now = kinematics.joint_angles(observation, pose)
        target = kinematics.joint_angles(observation, next_pose)
        error = target - joints
        lag = float(np.abs(now - joints)[1:3].max())
        rate = min(1.0, max(0.0, 2.0 - 2.0 * lag / _MAX_ARM_LAG))
        error[0] = remaining - swing_rate * _DRIVE_DELAY
        distance = np.abs(error)
        speeds = np.minimum(_GAIN * distance, np.sqrt(self._braking * distance))
        speeds[0] = rate * min(speeds[0], self._swing_speed)
        final_error = float(np.abs(end - joints).max())
        final_speed = float(np.abs(velocities).max())
        self._is_done = final_error < _MAX_FINAL_ERROR and final_speed < _MAX_FINAL_SPEED
        return np.asarray(np.copysign(speeds, error), dtype=np.float64)

    def _pose_with_remaining(self, angle: float) -> BucketPose:
        """Return the pose of the path where a swing angle [rad] is left."""
        is_swing = abs(self._angle) > _MIN_ANGLE
        progress = min(max(1.0 - angle / self._angle, 0.0), 1.0) if is_swing else 1.0
        position = progress * (len(self._poses) - 1)
        k = min(int(position), len(self._poses) - 2)
        pose = self._poses[k] + (position - k) * (self._poses[k + 1] - self._poses[k])
        return BucketPose(*pose.tolist())
