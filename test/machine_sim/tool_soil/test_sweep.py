from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import ArrayLike
from support.machine_scenes import excavator

from machine_sim.dem import Pose
from machine_sim.machine.arm_kinematics import tool_pose
from machine_sim.machine.tracks.track_model import ShoeTable, Tracks, sole_contact
from machine_sim.machine.tracks.track_state import SHOE_X, SHOE_Z
from machine_sim.tool_soil.sweep import PlateSweep, TrackSweep
from msg_bridge.contract.rows import Rows, SweepAction

MACHINE = excavator()
BUCKET = MACHINE.bucket
DIGGING = tool_pose(MACHINE, np.zeros(3), np.eye(3), [0.0, -0.35, 1.3, 1.1])


def bucket_sweep(tool_id: int = 0) -> PlateSweep:
    return PlateSweep(BUCKET.key_points, BUCKET.outward_normals, tool_id)


def rows_of(start: Pose, end: Pose, tool_id: int = 0) -> Rows:
    sweep = bucket_sweep(tool_id)
    sweep.move(start, end)
    return sweep.rows()


def moved(way: tuple[float, float, float]):
    rotation, origin = DIGGING
    return rotation, origin + np.array(way)


def test_rows_are_key_points_lip_first_left_before_right() -> None:
    rows = rows_of(DIGGING, moved((-0.01, 0, 0)), tool_id=3)
    assert rows.size == 14
    assert rows["pair"].tolist() == [k // 2 for k in range(14)]
    assert (rows["tool"] == 3).all()
    assert (rows["y0"][0::2] > rows["y0"][1::2]).all()
    lip = DIGGING[0] @ BUCKET.key_points[0] + DIGGING[1]
    assert [rows["x0"][0], rows["y0"][0], rows["z0"][0]] == pytest.approx(lip, abs=1e-5)
    assert rows["x1"] - rows["x0"] == pytest.approx(-0.01, abs=1e-5)


def test_bucket_moved_lip_first_cuts() -> None:
    rows = rows_of(DIGGING, moved((-0.01, 0, -0.002)))
    assert (rows["action"][:6] == SweepAction.CUT).all()


def test_bucket_pushed_onto_its_back_compacts() -> None:
    rotation, _ = DIGGING
    outward = rotation @ BUCKET.outward_normals[3]
    rows = rows_of(DIGGING, moved(tuple(0.01 * outward)))
    assert (rows["action"][6:8] == SweepAction.COMPACT).all()


def test_bucket_at_rest_cuts() -> None:
    assert (rows_of(DIGGING, DIGGING)["action"] == SweepAction.CUT).all()


def tracks_on_end_shoes(loads: ArrayLike, z: tuple[float, float] = (0.0, 0.0)) -> Tracks:
    """Return tracks with a loaded shoe at each end, at heights of the left and right track.

    Args:
        loads: of the front and the rear shoe of each track [N], shape (2, 2).
        z: of the shoes of each track [m].
    """
    poses = np.zeros((2, 2, 3))
    poses[:, :, SHOE_X] = 0.45 * MACHINE.tracks.axle_distance * np.array([1.0, -1.0])
    poses[:, :, SHOE_Z] = np.array(z)[:, None]
    shoes = SimpleNamespace(spec=MACHINE, shoe_poses=poses, shoe_loads=np.array(loads))
    return cast(Tracks, shoes)


def test_driving_tracks_compact_below_their_shoes() -> None:
    start, end = (np.eye(3), np.zeros(3)), (np.eye(3), np.array([0.02, 0.0, 0.0]))
    tracks = MACHINE.tracks
    rows = TrackSweep(tracks_on_end_shoes(np.zeros((2, 2))), 1).rows(start, end)
    assert rows["tool"].tolist() == [1] * 4 + [2] * 4
    assert rows["pair"].tolist() == [0, 0, 1, 1] * 2
    assert (rows["action"] == SweepAction.COMPACT).all()
    left = rows[:4]
    assert np.ptp(left["x0"]) == pytest.approx(tracks.axle_distance)
    assert np.ptp(left["y0"]) == pytest.approx(tracks.shoe_width)
    assert left["y0"].mean() == pytest.approx(0.5 * tracks.gauge)
    assert (left["y0"][0::2] > left["y0"][1::2]).all(), "left ends first"
    assert rows["x1"] - rows["x0"] == pytest.approx(0.02, abs=1e-6)
    assert not rows["z0"].any()


def test_rows_of_tracks_have_the_pressure_of_their_ends() -> None:
    start, end = (np.eye(3), np.zeros(3)), (np.eye(3), np.array([0.02, 0.0, 0.0]))
    tracks = tracks_on_end_shoes([[60e3, 50e3], [40e3, 50e3]], z=(-0.1, -0.2))
    contact = sole_contact(ShoeTable.of(tracks))
    rows = TrackSweep(tracks, 1).rows(start, end)
    front, left = rows["x0"] > 0.0, rows["y0"] > 0.0
    for is_front, pressures in (
        (True, contact.front_pressures),
        (False, contact.rear_pressures),
    ):
        for is_left, pressure, z in zip((True, False), pressures, contact.heights, strict=True):
            of_end = rows[(front == is_front) & (left == is_left)]
            assert of_end["pressure"] == pytest.approx([pressure] * 2)
            assert of_end["z1"] == pytest.approx([z] * 2)
    assert len({*rows["pressure"].tolist()}) == 4


def test_standing_tracks_do_not_compact() -> None:
    pose = (np.eye(3), np.array([3.0, 1.0, 0.2]))
    assert TrackSweep(tracks_on_end_shoes(np.zeros((2, 2))), 1).rows(pose, pose).size == 0
