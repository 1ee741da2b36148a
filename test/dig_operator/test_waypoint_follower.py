"""WaypointFollower: smooth at the ends, and waiting for a machine that lags."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.operator_scenes import ARM, observation, tilted

from dig_operator.bucket_kinematics import BucketPose
from dig_operator.waypoint_follower import Waypoint, WaypointFollower, path_time_at

DT = 0.02
START = BucketPose(0.0, 5.5, 1.5, 2.4)
WAYPOINTS = [
    Waypoint(BucketPose(0.3, 5.8, 1.2, 2.2), 1.0),
    Waypoint(BucketPose(0.6, 5.0, 1.8, 2.8), 2.0),
]
TOTAL = 3.0 + 0.5  # path time and acceleration time [s]


def follow(motion: WaypointFollower, observed, dt: float = DT, timeout: float = 10.0):
    """Move the joints as commanded; return the commands (n, 4) and the final observation."""
    commands = []
    while not motion.done and len(commands) * dt < timeout:
        commands.append(motion.advance(observed, ARM, dt))
        joints = observed.joints + commands[-1] * dt
        observed = observation(
            joints, position=observed.base_position, rotation=observed.base_rotation
        )
    return np.array(commands), observed


def at_start(**base):
    return observation(ARM.joint_angles(observation(**base), START), **base)


@pytest.mark.parametrize("rotation", [tilted(), tilted(roll=0.1, pitch=-0.1, yaw=0.5)])
def test_motion_ends_at_its_last_waypoint(rotation):
    _, end = follow(WaypointFollower(START, WAYPOINTS), at_start(rotation=rotation))
    assert ARM.bucket_pose(end) == pytest.approx(WAYPOINTS[-1].pose, abs=0.01)


def test_motion_passes_through_its_first_waypoint():
    motion, observed = WaypointFollower(START, WAYPOINTS), at_start()
    min_distance = np.inf
    while not motion.done:
        observed = observation(observed.joints + motion.advance(observed, ARM, DT) * DT)
        distance = np.abs(np.subtract(ARM.bucket_pose(observed), WAYPOINTS[0].pose)).max()
        min_distance = min(min_distance, distance)
    assert min_distance < 0.02


def test_set_point_is_interpolated_between_waypoints():
    motion = WaypointFollower(START, WAYPOINTS)
    poses = np.array([START, *(waypoint.pose for waypoint in WAYPOINTS)])
    for time in np.linspace(0.0, TOTAL, 41).tolist():
        expected = [
            np.interp(path_time_at(time, 3.0, 0.5), [0.0, 1.0, 3.0], column) for column in poses.T
        ]
        assert motion.set_point(time) == pytest.approx(expected, abs=1e-12)


def test_motion_swings_the_shorter_direction_across_pi():
    start, end = START._replace(azimuth=3.1), START._replace(azimuth=-3.1)
    behind = observation(ARM.joint_angles(observation([3.0, 0.0, 1.0, 0.0]), start))
    _, observed = follow(WaypointFollower(start, [Waypoint(end, 1.0)]), behind)
    assert observed.joints[0] - behind.joints[0] == pytest.approx(2 * np.pi - 6.2, abs=0.01)


def test_motion_takes_the_duration_of_its_waypoints():
    commands, _ = follow(WaypointFollower(START, WAYPOINTS), at_start())
    assert len(commands) * DT == pytest.approx(TOTAL, abs=2 * DT)


def test_motion_begins_and_ends_at_rest():
    commands, _ = follow(WaypointFollower(START, WAYPOINTS), at_start())
    speed = np.abs(commands).max(axis=1)
    assert speed[0] < 0.05 * speed.max()
    assert speed[-1] < 0.05 * speed.max()


def test_commanded_velocities_change_smoothly():
    commands, _ = follow(WaypointFollower(START, [WAYPOINTS[-1]]), at_start())
    assert np.abs(np.diff(commands, axis=0)).max() < 3.0 * DT


def test_set_point_waits_for_blocked_joints():
    motion, blocked = WaypointFollower(START, WAYPOINTS), at_start()
    commands = [motion.advance(blocked, ARM, DT) for _ in range(round(3 * TOTAL / DT))]
    assert not motion.done
    assert np.abs(commands[-1]).max() < 0.6  # the error stays bounded


def test_set_point_continues_when_the_joints_are_free():
    motion, blocked = WaypointFollower(START, WAYPOINTS), at_start()
    for _ in range(round(3 * TOTAL / DT)):
        motion.advance(blocked, ARM, DT)
    _, end = follow(motion, blocked)
    assert motion.done
    assert ARM.bucket_pose(end) == pytest.approx(WAYPOINTS[-1].pose, abs=0.02)


def test_joint_errors_are_corrected():
    pose = BucketPose(0.0, 5.5, 1.5, 2.4)
    motion = WaypointFollower(pose, [Waypoint(pose, 3.0)])
    off = observation(at_start().joints + np.array([0.03, -0.03, 0.03, -0.03]))
    command = motion.advance(off, ARM, DT)
    assert (np.sign(command) == [-1, 1, -1, 1]).all()
    _, end = follow(motion, off)
    assert ARM.bucket_pose(end) == pytest.approx(pose, abs=1e-3)


def test_bucket_keeps_its_pose_when_the_base_tilts():
    motion, observed = WaypointFollower(START, [Waypoint(START, 4.0)]), at_start()
    for _ in range(150):
        observed = observation(
            observed.joints + motion.advance(observed, ARM, DT) * DT,
            rotation=tilted(pitch=0.05, roll=0.03),
        )
    assert ARM.bucket_pose(observed) == pytest.approx(START, abs=2e-3)


@settings(max_examples=200, deadline=None)
@given(st.floats(0.01, 100.0), st.floats(0.001, 0.25))
def test_path_time_is_monotonic_and_ends_exactly(total, part):
    times = np.linspace(0.0, (1.0 + part) * total, 500)
    path_times = np.array([path_time_at(t, total, part * total) for t in times])
    assert (np.diff(path_times) >= 0.0).all()
    assert path_times[0] == 0.0
    assert path_times[-1] == pytest.approx(total, abs=1e-12)


@pytest.mark.parametrize(("time", "end"), [(1e-4, 0.0), (4.5 - 1e-4, 4.0)])
def test_path_time_is_at_rest_at_both_ends(time, end):
    assert abs(path_time_at(time, 4.0, 0.5) - end) < 1e-3 * 1e-4 * 4.0


def test_path_time_has_constant_rate_in_between():
    times = np.linspace(0.6, 3.4, 50)
    path_times = np.array([path_time_at(t, 4.0, 0.5) for t in times])
    assert np.diff(path_times, 2) == pytest.approx(0.0, abs=1e-12)
