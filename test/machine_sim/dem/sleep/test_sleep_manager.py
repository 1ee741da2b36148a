"""Particles at rest, and soil that rides in a tool as one body."""

from __future__ import annotations

import numpy as np
import pytest
from support.particle_scenes import LITRE, STEP, box, cloud, engine, pose, run

from machine_sim.dem import ParticleEngine

COUNT = 150


def resting_heap(**params: float) -> ParticleEngine:
    world = engine(**params)
    points = cloud(COUNT, 0.1, (0.6, 0.6), 0.02)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 5.0)
    return world


def loaded_box(**params: float) -> ParticleEngine:
    """A box of soil at rest, 1 m over the ground."""
    world = engine(**params)
    world.add_tool(0, box(0.6, 0.6, 0.6), pose(0.0, 0.0, 1.0))
    points = cloud(COUNT, 0.1, (0.45, 0.45), 1.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    return world


def riding(world: ParticleEngine) -> int:
    return int((world.state.sleep_state > 1).sum())


def tip(world: ParticleEngine, angle: float, seconds: float) -> None:
    """Turn the box about y by `angle` [rad] at an even rate."""
    steps = round(seconds / STEP)
    at = pose(0.0, 0.0, 1.0)
    for k in range(steps):
        to = pose(0.0, 0.0, 1.0, angle * (k + 1) / steps)
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        at = to


def test_a_heap_falls_asleep_where_it_lies() -> None:
    world = resting_heap()
    assert (world.state.sleep_state == 1).all()
    assert world.kinetic_energy == 0.0
    before = world.state.position.copy()
    run(world, 1.0)
    np.testing.assert_array_equal(world.state.position, before)


def test_nobody_sleeps_where_that_is_not_asked() -> None:
    assert (resting_heap(allow_sleeping=False).state.sleep_state == 0).all()


def test_who_lies_on_one_that_falls_asleep_does_not_rise() -> None:
    world = engine(allow_sleeping=False)
    world.add([[0, 0, 0.06], [0, 0, 0.18]], np.zeros((2, 3)), LITRE, grow=False)
    run(world, 2.0)
    height = world.state.position[1, 2]
    world._sleep_manager.wake_rows(world.state, np.arange(2))
    world.state.sleep_state[0] = 1
    world._pairs.is_stale = world._changed = True
    run(world, 0.3)
    assert world.state.sleep_state.tolist() == [1, 0]
    # A contact twice as stiff would lift it by half the overlap, 50 micrometres.
    assert world.state.position[1, 2] == pytest.approx(height, abs=5e-6)


def test_a_heap_woken_again_and_again_stays_as_it_is() -> None:
    world = resting_heap()
    ids = world.state.particle_id.copy()
    before = world.state.position.copy()
    for _ in range(40):
        world._sleep_manager.wake_rows(world.state, np.arange(COUNT))
        world._pairs.is_stale = True
        run(world, 0.55)
    assert (world.state.sleep_state == 1).all(), "at rest at once"
    rows = world.rows_of(ids)
    way = np.linalg.norm(world.state.position[rows] - before, axis=1)
    way /= 2.0 * world.state.radius[rows]
    assert way.max() < 0.005


def test_a_hit_wakes_whom_it_hits_and_all_sleep_again() -> None:
    world = resting_heap()
    new = world.add([[0.05, 0.0, 1.5]], [[0.0, 0.0, -2.0]], LITRE, grow=False)
    woken = 0
    for _ in range(300):
        world.step(STEP)
        woken = max(woken, int((world.state.sleep_state == 0).sum()))
    assert 2 <= woken < COUNT
    assert world.state.position[world.rows_of(new)[0], 2] < 0.6
    run(world, 4.0)
    assert (world.state.sleep_state == 1).all()


def test_who_loses_its_support_wakes_and_falls() -> None:
    world = engine()
    ids = world.add([[0, 0, 0.06], [0, 0, 0.18]], np.zeros((2, 3)), LITRE, grow=False)
    run(world, 2.0)
    assert (world.state.sleep_state == 1).all()
    world.remove(ids[:1])
    run(world, 0.2)
    assert world.state.position[0, 2] < 0.1


def test_ground_that_goes_wakes_those_on_it_and_no_others() -> None:
    world = engine()
    world.add([[0, 0, 0.06], [5.0, 0, 0.06]], np.zeros((2, 3)), LITRE, grow=False)
    run(world, 2.0)
    grid = world.ground.grid
    rows, cols = np.nonzero(
        np.hypot(grid.x(np.arange(64))[:, None], grid.y(np.arange(64))[None, :]) < 1.0
    )
    world.ground.set_heights(rows, cols, np.full(rows.size, -0.5))
    world.step(STEP)
    assert world.state.sleep_state.tolist() == [0, 1]
    run(world, 0.5)
    assert world.state.position[0, 2] < -0.3


def test_a_tool_that_comes_by_wakes() -> None:
    world = resting_heap()
    world.add_tool(0, [box(0.4, 0.4, 0.4)[1]], pose(-3.0, 0.0, 0.02))
    at = pose(-3.0, 0.0, 0.02)
    for k in range(600):
        to = pose(-3.0 + 0.006 * (k + 1), 0.0, 0.02)
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        at = to
    assert world.state.position[:, 0].max() > 0.7, "it was pushed"
    assert world.num_plate_tunnellings == 0


def test_soil_in_a_box_rides_as_one_body_and_weighs_what_it_weighs() -> None:
    world = loaded_box()
    rides = world.state.sleep_state > 1
    assert rides.mean() > 0.95
    local = world.positions_in_tool_frame(0)[rides]
    at = pose(0.0, 0.0, 1.0)
    for k in range(400):
        to = pose(0.3 * np.sin(0.004 * k) ** 2, 0.0, 1.0 + 0.3 * np.sin(0.004 * k) ** 2)
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        at = to
    assert riding(world) > 0.95 * COUNT
    moved = np.linalg.norm(world.positions_in_tool_frame(0)[rides] - local, axis=1)
    assert (moved < 1e-9).mean() > 0.95
    world.set_tool_motion(0, at, at)
    run(world, 1.0)
    force, torque = world.tool_wrench(0)
    weight = 9.81 * float(world.state.mass.sum())
    assert force[2] == pytest.approx(-weight, rel=1e-3)
    arm = (world.state.mass[:, None] * (world.state.position - at[1])).sum(axis=0) * 9.81
    np.testing.assert_allclose(torque[:2], [-arm[1], arm[0]], atol=1e-3 * weight)


def test_it_is_the_same_load_whether_it_rides_or_not() -> None:
    wrenches = [
        loaded_box(allow_load_locking=allow_load_locking).tool_wrench(0)
        for allow_load_locking in (True, False)
    ]
    np.testing.assert_allclose(wrenches[0][0], wrenches[1][0], atol=2.0)
    np.testing.assert_allclose(wrenches[0][1], wrenches[1][1], atol=8.0)


def test_a_small_tilt_does_not_wake_it_a_larger_one_does() -> None:
    world = loaded_box()
    tip(world, np.radians(4.0), 1.0)
    assert riding(world) > 0.95 * COUNT
    tip(world, np.radians(12.0), 1.0)
    assert riding(world) < COUNT


def test_a_jolt_wakes_it() -> None:
    world = loaded_box()
    at = pose(0.0, 0.0, 1.0)
    for k in range(60):
        to = pose(0.5 * 4.0 * (STEP * (k + 1)) ** 2, 0.0, 1.0)  # 4 m/s^2
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        at = to
    assert riding(world) == 0


def test_it_pours_out_alike_riding_or_not() -> None:
    halves = []
    for allow_load_locking in (True, False):
        world = loaded_box(allow_load_locking=allow_load_locking)
        tilt, left = np.linspace(0.0, 170.0, 800), []
        at = pose(0.0, 0.0, 1.0)
        for angle in tilt:
            to = pose(0.0, 0.0, 1.0, np.radians(angle))
            world.set_tool_motion(0, at, to)
            world.step(STEP)
            at = to
            local = world.positions_in_tool_frame(0)
            inside = (np.abs(local[:, :2]) < 0.3).all(axis=1) & (local[:, 2] < 0.6)
            left.append(float(inside.mean()))
        halves.append(tilt[np.argmax(np.array(left) < 0.5)])
        assert left[-1] == 0.0
        assert world.total_volume_mm3 == COUNT * (LITRE // 2)
        assert world.num_plate_tunnellings == 0
    assert abs(halves[0] - halves[1]) < 5.0


def test_what_a_box_held_falls_when_the_box_is_taken_away() -> None:
    world = loaded_box()
    world.remove_tool(0)
    run(world, 0.6)
    assert world.state.position[:, 2].max() < 0.7


def test_a_rerun_with_sleepers_is_identical_to_the_bit() -> None:
    def state() -> tuple[bytes, ...]:
        world = loaded_box()
        tip(world, np.radians(40.0), 1.0)
        state = world.state
        return state.position.tobytes(), state.velocity.tobytes(), state.sleep_state.tobytes()

    assert state() == state()
