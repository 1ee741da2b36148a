"""Following way points: smooth at the ends, and never ahead of what the machine can do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.operator_scenes import ARM, observation, tilted

from dig_operator.bucket_kinematics import BucketPose
from dig_operator.waypoint_follower import Waypoint, WaypointFollower, _path_time_at

DT = 0.02
START = BucketPose(0.0, 5.5, 1.5, 2.4)
TARGETS = [
    Waypoint(BucketPose(0.3, 5.8, 1.2, 2.2), 1.0),
    Waypoint(BucketPose(0.6, 5.0, 1.8, 2.8), 2.0),
]
TOTAL = 3.0 + 1.0  # what the targets take, and what speeding up and slowing down adds


def follow(motion: WaypointFollower, seen, dt: float = DT, timeout: float = 10.0):
    """Joints go as commanded; returns the commands (n, 4) and what is seen at the end."""
    commands = []
    while not motion.done and len(commands) * dt < timeout:
        commands.append(motion.advance(seen, ARM, dt))
        joints = seen.joints + commands[-1] * dt
        seen = observation(joints, position=seen.base_position, rotation=seen.base_rotation)
    return np.array(commands), seen


def at_start(**base):
    return observation(ARM.joint_angles(observation(**base), START), **base)


@pytest.mark.parametrize("rotation", [tilted(), tilted(roll=0.1, pitch=-0.1, yaw=0.5)])
def test_motion_ends_at_its_last_target(rotation):
    _, end = follow(WaypointFollower(START, TARGETS), at_start(rotation=rotation))
    assert ARM.bucket_pose(end) == pytest.approx(TARGETS[-1].pose, abs=0.01)


def test_motion_passes_through_its_first_target():
    motion, seen = WaypointFollower(START, TARGETS), at_start()
    nearest = np.inf
    while not motion.done:
        seen = observation(seen.joints + motion.advance(seen, ARM, DT) * DT)
        away = np.abs(np.subtract(ARM.bucket_pose(seen), TARGETS[0].pose)).max()
        nearest = min(nearest, away)
    assert nearest < 0.02


def test_set_point_goes_straight_from_place_to_place():
    motion = WaypointFollower(START, TARGETS)
    places = np.array([START, *(target.pose for target in TARGETS)])
    for time in np.linspace(0.0, TOTAL, 41).tolist():
        way = [
            np.interp(_path_time_at(time, 3.0, 1.0), [0.0, 1.0, 3.0], column) for column in places.T
        ]
        assert motion._set_point(time) == pytest.approx(way, abs=1e-12)


def test_motion_turns_the_short_way_where_directions_jump():
    start, end = START._replace(azimuth=3.1), START._replace(azimuth=-3.1)
    behind = observation(ARM.joint_angles(observation([3.0, 0.0, 1.0, 0.0]), start))
    _, seen = follow(WaypointFollower(start, [Waypoint(end, 1.0)]), behind)
    assert seen.joints[0] - behind.joints[0] == pytest.approx(2 * np.pi - 6.2, abs=0.01)


def test_motion_takes_the_time_it_was_given():
    commands, _ = follow(WaypointFollower(START, TARGETS), at_start())
    assert len(commands) * DT == pytest.approx(TOTAL, abs=2 * DT)


def test_motion_begins_and_ends_at_rest():
    commands, _ = follow(WaypointFollower(START, TARGETS), at_start())
    speed = np.abs(commands).max(axis=1)
    assert speed[0] < 0.05 * speed.max()
    assert speed[-1] < 0.05 * speed.max()


def test_motion_has_no_jerk_on_its_way():
    commands, _ = follow(WaypointFollower(START, [TARGETS[-1]]), at_start())
    assert np.abs(np.diff(commands, axis=0)).max() < 3.0 * DT


def test_set_point_waits_for_joints_that_do_not_follow():
    motion, stuck = WaypointFollower(START, TARGETS), at_start()
    commands = [motion.advance(stuck, ARM, DT) for _ in range(round(3 * TOTAL / DT))]
    assert not motion.done
    assert np.abs(commands[-1]).max() < 0.6  # it waits near by, and does not pull ever harder


def test_set_point_goes_on_when_the_joints_have_come():
    motion, stuck = WaypointFollower(START, TARGETS), at_start()
    for _ in range(round(3 * TOTAL / DT)):
        motion.advance(stuck, ARM, DT)
    _, end = follow(motion, stuck)
    assert motion.done
    assert ARM.bucket_pose(end) == pytest.approx(TARGETS[-1].pose, abs=0.02)


def test_joints_that_are_off_are_brought_back():
    pose = BucketPose(0.0, 5.5, 1.5, 2.4)
    motion = WaypointFollower(pose, [Waypoint(pose, 3.0)])
    off = observation(at_start().joints + np.array([0.03, -0.03, 0.03, -0.03]))
    command = motion.advance(off, ARM, DT)
    assert (np.sign(command) == [-1, 1, -1, 1]).all()
    _, end = follow(motion, off)
    assert ARM.bucket_pose(end) == pytest.approx(pose, abs=1e-3)


def test_bucket_keeps_to_its_way_when_the_base_tilts():
    motion, seen = WaypointFollower(START, [Waypoint(START, 4.0)]), at_start()
    for _ in range(150):
        seen = observation(
            seen.joints + motion.advance(seen, ARM, DT) * DT, rotation=tilted(pitch=0.05, roll=0.03)
        )
    assert ARM.bucket_pose(seen) == pytest.approx(START, abs=2e-3)


@settings(max_examples=200, deadline=None)
@given(st.floats(0.01, 100.0), st.floats(0.001, 0.25))
def test_eased_time_never_goes_back_and_ends_exactly(total, part):
    times = np.linspace(0.0, (1.0 + part) * total, 500)
    way = np.array([_path_time_at(t, total, part * total) for t in times])
    assert (np.diff(way) >= 0.0).all()
    assert way[0] == 0.0
    assert way[-1] == pytest.approx(total, abs=1e-12)


@pytest.mark.parametrize(("time", "end"), [(1e-4, 0.0), (4.5 - 1e-4, 4.0)])
def test_eased_time_stands_still_at_both_ends(time, end):
    assert abs(_path_time_at(time, 4.0, 0.5) - end) < 1e-3 * 1e-4 * 4.0


def test_eased_time_runs_evenly_between():
    times = np.linspace(0.6, 3.4, 50)
    way = np.array([_path_time_at(t, 4.0, 0.5) for t in times])
    assert np.diff(way, 2) == pytest.approx(0.0, abs=1e-12)
