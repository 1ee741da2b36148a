"""Cycles, latencies and thinned traces of values with known answers."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from earthmoving_sim.run_report import terrain_history
from earthmoving_sim.run_report.latency import CommandLatency
from earthmoving_sim.run_report.production import rate_lines, total_lines
from earthmoving_sim.run_report.run_data import RunData
from earthmoving_sim.run_report.summary import summarise
from earthmoving_sim.run_report.terrain_history import TerrainHistory
from earthmoving_sim.run_report.trace import Trace
from earthmoving_sim.run_report.way import Way
from earthmoving_sim.run_report.work_cycles import find_work_cycles
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import MAP_UPDATE, empty_rows

CYCLE = 20.0
POINTS = ((0, 0.0), (5, 0.0), (9, 1.0), (10, 0.8), (16, 0.8), (17, 0.0), (20, 0.0))
"""Payload over the time of a cycle: it digs from 5 to 9 s, loses a fifth, and dumps at 16 s."""


def payload(num_cycles: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    times = np.arange(0.0, num_cycles * CYCLE + 1.0, 0.02)
    knots, values = np.array(POINTS).T
    return times, np.interp(times % CYCLE, knots, values)


def test_production_is_drawn_up_to_the_end_of_the_recording() -> None:
    total = Trace()
    for second in range(10, 50):
        total.add(float(second), 0.1 * (second - 9))
    (line,) = total_lines({1: total}, (0.0, 100.0))
    assert line.times[[0, -1]].tolist() == [0.0, 100.0]
    assert line.values[[0, -1]] == pytest.approx([0.0, 4.0])
    (rate,) = rate_lines({1: total}, (0.0, 100.0))
    assert rate.values[rate.times > 50.0].tolist() == [0.0] * 30
    assert rate.values.sum() * (100.0 / 60.0) / 3600.0 == pytest.approx(4.0)


def test_cycles_have_the_times_and_volumes_of_their_parts() -> None:
    times, values = payload(3)
    swing = np.where((times % CYCLE > 12.0) & (times % CYCLE < 15.0), 0.5, 0.0)
    cycles = find_work_cycles(times, values, times, swing)
    assert len(cycles) == 3
    for number, cycle in enumerate(cycles):
        assert cycle.volume == pytest.approx(0.8, abs=0.01)
        # The dig is from 5 to 95 % of 1 m3; the dump from 90 % of 0.8 m3 to 15 % of 1 m3.
        assert cycle.dig_time == pytest.approx(3.6, abs=0.05)
        assert cycle.lift_time == pytest.approx(12.0 - 8.8, abs=0.05)
        assert cycle.swing_time == pytest.approx(16.1 - 12.0, abs=0.05)
        assert cycle.dump_time == pytest.approx(16.8 - 16.1, abs=0.05)
        assert cycle.return_time == pytest.approx(8.4 if number else 5.2, abs=0.05)
        parts = (cycle.return_time, cycle.dig_time, cycle.lift_time, cycle.swing_time)
        assert sum(parts) + cycle.dump_time == pytest.approx(cycle.duration)
    assert cycles[1].duration == pytest.approx(CYCLE, abs=0.05)
    assert cycles[1].productivity == pytest.approx(0.8 * 3600.0 / CYCLE, rel=0.02)


def test_swing_that_is_not_recorded_is_part_of_the_lift() -> None:
    (cycle,) = find_work_cycles(*payload(1))
    assert cycle.swing_time == 0.0
    assert cycle.lift_time == pytest.approx(16.1 - 8.8, abs=0.05)


def test_cycle_that_had_begun_before_the_recording_is_left_out() -> None:
    times, values = payload(3)
    is_recorded = times > 12.0
    cycles = find_work_cycles(times[is_recorded], values[is_recorded])
    assert [cycle.duration for cycle in cycles] == pytest.approx([CYCLE, CYCLE], abs=0.05)


def test_payload_that_is_never_dumped_is_no_cycle() -> None:
    times = np.arange(0.0, 10.0, 0.1)
    assert find_work_cycles(times, np.minimum(times, 1.0)) == []
    assert find_work_cycles(times, np.zeros(times.size)) == []


def test_latency_is_from_the_command_to_the_tick_that_applies_it() -> None:
    latency = CommandLatency()
    latency.add_command("/c", (0.0,), 0.0, 0.0, {"boom": 0.0})
    applied = 0.0
    for tick in range(1, 200):
        time = 0.01 * tick
        if tick % 20 == 0:  # another velocity, 3 ticks before it is applied
            latency.add_command("/c", (float(tick),), time + 0.002, time, {"boom": float(tick)})
        if tick % 20 == 3:
            applied = float(tick - 3)
        latency.add_applied({"boom": applied, "arm": 0.1 * (tick % 2)}, time, time)
    assert latency.num_commands == 9
    assert len(latency.samples) == 9
    assert [each.wall for each in latency.samples] == pytest.approx(9 * [0.028])
    assert [each.simulated for each in latency.samples] == pytest.approx(9 * [0.03])


def test_command_without_velocities_has_its_effect_at_the_next_change() -> None:
    latency = CommandLatency()
    latency.add_command("/joy", (0.0,), 0.0, None)
    latency.add_applied({"boom": 0.0}, 0.1, 0.1)
    latency.add_command("/joy", (1.0,), 0.2, None)
    latency.add_applied({"boom": 0.0}, 0.3, 0.3)
    latency.add_applied({"boom": 0.5}, 0.4, 0.4)
    assert latency.samples == [(pytest.approx(0.2), None)]


def test_long_trace_keeps_its_extremes_in_bounded_memory() -> None:
    trace = Trace(capacity=1000)
    rng = np.random.default_rng(0)
    values = rng.normal(size=100_000)
    values[77_777], values[12_345] = 50.0, -50.0
    for number, value in enumerate(values):
        trace.add(0.01 * number, value)
    trace.add(2000.0, np.nan)
    assert len(trace) < 1600
    assert (trace.values.max(), trace.values.min()) == (50.0, -50.0)
    assert trace.times[np.argmax(trace.values)] == pytest.approx(777.77)
    assert (np.diff(trace.times) >= 0.0).all()
    assert trace.times[-1] > 999.0


def test_long_way_has_its_length_and_its_corners_in_bounded_memory() -> None:
    way = Way(capacity=1000)
    side = np.linspace(0.0, 50.0, 2501)
    corner, stop = np.full_like(side, 50.0), np.zeros_like(side)
    for _ in range(20):  # rounds of a truck that waits at two corners of a square
        for x, y in (
            (side, stop),
            (corner, stop),
            (corner, side),
            (side[::-1], corner),
            (stop, corner),
            (stop, side[::-1]),
        ):
            for position in zip(x.tolist(), y.tolist(), strict=True):
                way.add(*position)
    way.add(np.nan, 0.0)
    assert way.length == pytest.approx(20 * 200.0)
    positions = way.positions
    assert 500 < len(positions) <= 1001
    on_edge = np.isclose(positions, 0.0) | np.isclose(positions, 50.0)
    assert on_edge.any(axis=1).all(), "x and y of the same time"
    assert positions[-1] == pytest.approx([0.0, 0.0])


def test_terrain_is_that_of_the_newest_state_of_each_column() -> None:
    grid = Grid(rows=3, cols=4, cell=1.0)
    layer = np.zeros(grid.shape, np.uint8)

    def terrain(revision: int, height: float) -> TerrainMap:
        volume = np.full(grid.shape, round(height * 1e9))
        frame = Keyframe(1, revision, grid, np.full(grid.shape, height), volume, layer, layer)
        return TerrainMap(frame, np.zeros(grid.shape))

    history = TerrainHistory()
    rows = empty_rows(MAP_UPDATE, 2)
    rows["row"], rows["col"], rows["revision"] = [0, 9], [1, 9], 7  # one outside of the map
    rows["z"], rows["volume_mm3"] = 3.0, 3e9
    older = rows.copy()
    older["revision"], older["z"] = 4, 9.0
    history.add_updates(rows)  # newer than the map that follows
    history.add_updates(older)
    history.add_map(terrain(5, 2.0), 1.5)
    history.add_map(terrain(6, 1.0), 2.5)  # older than the row, newer than the map
    expected = np.full(grid.shape, -(10**9))
    expected[0, 1] = 10**9
    assert np.array_equal(history.volume_change, expected)
    assert history.after[0, 1] == 3.0
    assert (history.start_revision, history.start_time) == (5, 1.5)


def test_many_updates_before_the_first_map_are_reduced_to_the_newest_of_each_column(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(terrain_history, "_MAX_EARLY", 5)
    grid = Grid(rows=2, cols=2, cell=1.0)
    history = TerrainHistory()
    for revision in range(1, 9):
        rows = empty_rows(MAP_UPDATE, 2)
        rows["col"], rows["revision"], rows["z"] = [0, 1], revision, [revision, -revision]
        history.add_updates(rows)
    zeros = np.zeros(grid.shape)
    layer = np.zeros(grid.shape, np.uint8)
    frame = Keyframe(1, 2, grid, zeros, zeros.astype(np.int64), layer, layer)
    history.add_map(TerrainMap(frame, zeros), 0.0)
    assert history.after.tolist() == [[8.0, -8.0], [0.0, 0.0]]


def test_soil_that_was_only_moved_is_cut_and_filled_to_the_mm3() -> None:
    grid = Grid(rows=20, cols=20, cell=1.0)
    layer, zeros = np.zeros(grid.shape, np.uint8), np.zeros(grid.shape)
    moved = np.random.default_rng(7).integers(0, 10**8, (10, 20))
    change = np.concatenate((-moved, np.sort(moved, axis=None).reshape(moved.shape)))
    run = RunData()
    for revision, volume in enumerate((np.full(grid.shape, 10**10), 10**10 + change)):
        frame = Keyframe(1, revision, grid, zeros, volume, layer, layer)
        run.terrain.add_map(TerrainMap(frame, zeros), float(revision))
    summary = summarise(run)
    assert summary.cut == summary.fill == pytest.approx(1e-9 * moved.sum())
