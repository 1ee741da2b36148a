"""SwingFollower on a machine whose swing has little torque and whose drives respond late."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from support.operator_scenes import ARM, observation

from dig_operator.bucket_kinematics import BucketPose
from dig_operator.swing_follower import SwingFollower

DT = 0.02
ACCELERATIONS = (0.7, 0.6, 1.2, 2.0)
START = BucketPose(0.2, 5.5, 1.5, ARM.level_attitude)
END = BucketPose(1.7, 6.2, 3.0, ARM.level_attitude)


class SwingRun(NamedTuple):
    """Times [s], joint angles [rad], (n, 4), and heights of the pin [m], (n,), of a swing."""

    times: NDArray[np.float64]
    joints: NDArray[np.float64]
    heights: NDArray[np.float64]
    is_done: bool


def poses(peak: float = 0.0) -> list[BucketPose]:
    """Return a path of nine poses that rises by `peak` [m] in its middle, 0.29 m a pose."""
    fractions = np.linspace(0.0, 1.0, 9)
    path = np.array([START]) + fractions[:, None] * (np.array(END) - np.array(START))
    path[:, 2] += np.maximum(peak - 0.29 * np.abs(np.arange(9) - 4), 0.0)
    return [BucketPose(*pose) for pose in path.tolist()]


def swing(
    path: list[BucketPose],
    *,
    acceleration: float = 0.65,
    delay: float = 0.2,
    is_boom_blocked: bool = False,
    timeout: float = 12.0,
) -> SwingRun:
    """Follow a path with a swing of limited acceleration [rad/s^2] and drives with a delay [s]."""
    follower = SwingFollower(path, swing_speed=0.9, max_joint_accelerations=ACCELERATIONS)
    joints = ARM.joint_angles(observation(), path[0])
    velocity = np.zeros(4)
    commands = deque([np.zeros(4)] * round(delay / DT))
    times, angles, heights = [], [], []
    while not follower.done and len(times) * DT < timeout:
        observed = observation(joints)
        commands.append(follower.advance(observed, ARM, DT))
        demanded = commands.popleft()
        change = np.clip(demanded - velocity, -acceleration * DT, acceleration * DT)
        velocity = np.array([velocity[0] + change[0], *demanded[1:]])
        if is_boom_blocked:
            velocity[1] = 0.0
        times.append(len(times) * DT)
        angles.append(joints)
        heights.append(ARM.bucket_pose(observed).height)
        joints = joints + velocity * DT
    return SwingRun(np.array(times), np.array(angles), np.array(heights), follower.done)


@pytest.mark.parametrize("acceleration", [0.55, 0.7, 0.9])
def test_swing_ends_at_its_target_without_overshoot(acceleration: float) -> None:
    run = swing(poses(), acceleration=acceleration)
    assert run.is_done
    assert ARM.bucket_pose(observation(run.joints[-1])) == pytest.approx(END, abs=0.25)
    target = run.joints[-1, 0]
    assert run.joints[:, 0].max() < target + 0.02
    # 1.5 rad at 0.9 rad/s, with acceleration and braking.
    assert run.times[-1] < 5.0


def test_bucket_rises_over_an_obstacle() -> None:
    low, high = swing(poses()), swing(poses(peak=1.0))
    middle = 0.5 * (START.azimuth + END.azimuth)
    at_middle = [float(np.interp(middle, run.joints[:, 0], run.heights)) for run in (low, high)]
    assert at_middle[1] > at_middle[0] + 0.75


@pytest.mark.parametrize("peak", [1.0, 1.5])
def test_bucket_stays_above_its_path_before_and_behind_an_obstacle(peak: float) -> None:
    path = np.array(poses(peak))
    run = swing(poses(peak))
    required = np.interp(run.joints[:, 0], path[:, 0], path[:, 2])
    assert (run.heights - required).min() > -0.12, "much less than the clearance of 0.5 m"


def test_swing_waits_for_an_arm_that_cannot_follow() -> None:
    run = swing(poses(peak=1.5), is_boom_blocked=True)
    assert not run.is_done
    assert run.joints[-1, 0] < 0.5 * (START.azimuth + END.azimuth)


def test_short_swing_goes_straight_to_its_target() -> None:
    start = END._replace(azimuth=END.azimuth - 0.02, attitude=END.attitude - 1.0)
    path = [start, END._replace(height=END.height + 1.0), END]
    run = swing(path)
    assert run.is_done
    assert run.heights.max() < END.height + 0.2
