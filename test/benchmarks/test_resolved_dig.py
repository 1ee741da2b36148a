"""The dig that is compared with a resolved DEM: its path in LIGGGHTS, and the comparison."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.machine_scenes import excavator

from benchmarks.liggghts_runner import is_installed
from benchmarks.resolved_dig.comparison import (
    compare,
    draw_comparison,
    read_tables,
    write_tables,
)
from benchmarks.resolved_dig.dig import INTERVAL, DigRecord, record_dig
from benchmarks.resolved_dig.liggghts_bed import dig_in_liggghts, write_input

NUM_INTERVALS = 12
RECORDED = Path(__file__).parents[2] / "validation"


def level_drag(depth: float = 0.2) -> DigRecord:
    """Return a drag at 1 m/s toward -x, with the lip straight below the pin."""
    bucket, count = excavator().bucket, NUM_INTERVALS
    times = INTERVAL * np.arange(1, count + 1)
    x = np.linspace(3.0, 8.4, 55)
    return DigRecord(
        bucket, 1500.0, 34.0, 20.0, times,
        np.column_stack([6.0 - times, np.zeros(count), np.full(count, bucket.tip_radius - depth)]),
        np.full(count, 0.5 * np.pi), np.tile([8e3, 0.0, -3e3], (count, 1)),
        np.linspace(0.0, 0.3, count), x, np.where(x > 5.6, -depth, 0.3),
    )  # fmt: skip


def test_ratios_are_those_of_the_first_to_the_second() -> None:
    first = level_drag()
    second = replace(
        first,
        force=0.5 * first.force,
        fill=np.where(np.arange(NUM_INTERVALS) % 3 == 2, first.fill / 3.0, np.nan),
        profile=0.25 * first.profile,
    )
    found = compare(first, second)
    assert found.force == pytest.approx(2.0)
    assert found.vertical == pytest.approx(2.0)
    assert found.work == pytest.approx(2.0)
    assert found.fill == pytest.approx(3.0)
    assert found.trench == pytest.approx(4.0, rel=0.2)
    assert compare(first, first) == pytest.approx((1.0,) * 6)


def test_tables_and_picture_are_written(tmp_path: Path) -> None:
    digs = {"ours": level_drag(), "liggghts": level_drag(0.3)}
    write_tables(tmp_path, digs)
    draw_comparison(tmp_path / "dig.png", digs)
    table = np.genfromtxt(tmp_path / "resolved_dig.csv", delimiter=",", names=True)
    assert table["liggghts_fx_n"].tolist() == [8e3] * NUM_INTERVALS
    assert table["x_m"] == pytest.approx(digs["ours"].origin[:, 0], rel=1e-4)
    profile = np.genfromtxt(tmp_path / "resolved_dig_profile.csv", delimiter=",", names=True)
    assert profile["ours_z_m"].min() == -0.2
    assert (tmp_path / "dig.png").stat().st_size > 10_000
    again = read_tables(tmp_path, "liggghts", level_drag())
    assert compare(again, digs["liggghts"]) == pytest.approx((1.0,) * 6, rel=1e-3)
    with pytest.raises(ValueError, match="other times"):
        read_tables(tmp_path, "liggghts", replace(again, times=again.times + 1.0))


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.parametrize("seed", [0, 1])
def test_dig_is_close_to_that_of_spheres_in_liggghts(seed: int) -> None:
    dig = record_dig(seed=seed)
    found = compare(dig, read_tables(RECORDED, "liggghts", dig))
    assert 0.75 < found.force < 1.25
    assert 0.75 < found.vertical < 1.25
    assert 0.75 < found.fill < 1.25
    assert 0.75 < found.berm < 1.25
    assert 0.9 < found.trench < 1.2


def test_segments_for_liggghts_follow_the_path(tmp_path: Path) -> None:
    level = level_drag()
    turning = replace(level, pitch=np.linspace(1.2, 1.6, NUM_INTERVALS))
    num_steps = write_input(turning, 0.2, tmp_path)
    script = (tmp_path / "in.txt").read_text()
    moves = re.findall(r"linear (\S+) (\S+) (\S+)\n.* period (\S+)\nrun (\d+)\n", script)
    velocity, periods = np.array(moves, dtype=float)[:, :3], np.array(moves, dtype=float)[:, 3]
    assert INTERVAL * velocity.sum(axis=0) == pytest.approx(level.origin[-1] - level.origin[0])
    assert 2.0 * np.pi * INTERVAL * (1.0 / periods).sum() == pytest.approx(0.4)
    assert {int(move[4]) for move in moves} == {num_steps}
    mesh = np.array(re.findall(r"vertex (\S+) (\S+) (\S+)", (tmp_path / "tool.stl").read_text()))
    distance = np.linalg.norm(mesh.astype(float) - turning.origin[0], axis=1)
    assert distance.max() == pytest.approx(np.hypot(level.bucket.tip_radius, 0.6), abs=0.1)


@pytest.mark.skipif(not is_installed(), reason="LIGGGHTS is not installed")
def test_bucket_in_liggghts_follows_the_path(tmp_path: Path) -> None:
    found = dig_in_liggghts(level_drag(), 0.12, tmp_path)
    assert found.force.shape == (NUM_INTERVALS, 3)
    assert found.force[5:, 0].mean() > 200.0, "the bed resists against the travel"
    assert np.nanmax(found.profile) < 0.5
    assert "axis" not in (tmp_path / "in.txt").read_text(), "the bucket does not turn"


def test_particles_add_the_inertia_of_the_soil_to_the_force() -> None:
    speeds = np.array([0.5, 2.0])
    forces = []
    for speed in speeds:
        dig = record_dig(speed=speed)
        is_level = (dig.times > 2.2 / speed) & (dig.times < 3.6 / speed)
        forces.append(dig.force[is_level, 0].mean())
    slow, fast = (0.57 * speeds) ** 2 * dig.density * 0.3 * dig.bucket.width
    assert fast - slow < forces[1] - forces[0] < 5.0 * (fast - slow)
