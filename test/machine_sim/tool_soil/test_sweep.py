import numpy as np
import pytest
from support.machine_scenes import excavator

from machine_sim.dem import Pose
from machine_sim.machine.arm_kinematics import tool_pose
from machine_sim.machine.tracks.track_model import SoleContact
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


def test_driving_tracks_compact_below_their_shoes() -> None:
    start, end = (np.eye(3), np.zeros(3)), (np.eye(3), np.array([0.02, 0.0, 0.0]))
    tracks = MACHINE.tracks
    rows = TrackSweep(tracks, 1).rows(start, end)
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
    contact = SoleContact((-0.1, -0.2), (60e3, 50e3), (20e3, 10e3))
    rows = TrackSweep(MACHINE.tracks, 1).rows(start, end, contact)
    front, left = rows["x0"] > 0.0, rows["y0"] > 0.0
    for is_front, is_left, pressure in (
        (True, True, 60e3), (True, False, 50e3), (False, True, 20e3), (False, False, 10e3)
    ):  # fmt: skip
        of_end = rows[(front == is_front) & (left == is_left)]
        assert of_end["pressure"].tolist() == [pressure] * 2
        assert of_end["z1"] == pytest.approx([-0.1 if is_left else -0.2] * 2)


def test_standing_tracks_do_not_compact() -> None:
    pose = (np.eye(3), np.array([3.0, 1.0, 0.2]))
    assert TrackSweep(MACHINE.tracks, 1).rows(pose, pose).size == 0
