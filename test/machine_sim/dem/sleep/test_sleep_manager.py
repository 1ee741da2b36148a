"""Sleep of particles at rest, and soil that is locked to a tool."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from support.particle_scenes import LITRE, STEP, box, cloud, drive, drive_steps, engine, pose, run

from machine_sim.dem import ParticleEngine, Pose
from machine_sim.dem.sleep import ASLEEP_ON_MAP, AWAKE, FIRST_LOCKED_TOOL
from msg_bridge.contract.constants import GRAVITY

COUNT = 150
BOX_POSE = pose(z=1.0)


def resting_heap(**params: float) -> ParticleEngine:
    world = engine(**params)
    points = cloud(COUNT, 0.1, (0.6, 0.6), 0.02)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 5.0)
    return world


def loaded_box(**params: float) -> ParticleEngine:
    """Return a box with soil at rest, 1 m over the ground."""
    world = engine(**params)
    world.add_tool(0, box(0.6, 0.6, 0.6), BOX_POSE)
    points = cloud(COUNT, 0.1, (0.45, 0.45), 1.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    return world


def num_locked(world: ParticleEngine) -> int:
    return int((world.sleep_states >= FIRST_LOCKED_TOOL).sum())


def all_asleep_on_map(world: ParticleEngine) -> bool:
    return bool((world.sleep_states == ASLEEP_ON_MAP).all())


def tilted(angles: np.ndarray) -> Iterator[Pose]:
    """Yield poses of the box at some angles [rad]."""
    return (pose(z=1.0, pitch=angle) for angle in angles)


def tilt(world: ParticleEngine, angle: float, seconds: float) -> None:
    """Rotate the box about y by `angle` [rad] at a constant rate."""
    drive(world, tilted(np.linspace(0.0, angle, round(seconds / STEP) + 1)))


def test_heap_at_rest_falls_asleep_and_does_not_move() -> None:
    world = resting_heap()
    assert all_asleep_on_map(world)
    assert world.kinetic_energy == 0.0
    before = world.positions.copy()
    run(world, 1.0)
    np.testing.assert_array_equal(world.positions, before)


def test_no_particle_sleeps_when_sleeping_is_disabled() -> None:
    assert (resting_heap(allow_sleeping=False).sleep_states == AWAKE).all()


def test_particle_keeps_its_height_on_one_that_sleeps() -> None:
    world = engine()
    ids = world.add([[0, 0, 0.06], [0, 0, 0.18]], np.zeros((2, 3)), LITRE, grow=False)
    run(world, 2.0)
    assert all_asleep_on_map(world)
    height = world.positions[1, 2]
    world.wake(ids[1:])
    run(world, 0.3)
    assert world.sleep_states.tolist() == [ASLEEP_ON_MAP, AWAKE]
    # A contact twice as stiff would lift it by half the overlap, 50 micrometres.
    assert world.positions[1, 2] == pytest.approx(height, abs=5e-6)


def test_heap_that_is_woken_repeatedly_does_not_creep() -> None:
    world = resting_heap()
    ids, before = world.ids.copy(), world.positions.copy()
    for _ in range(40):
        world.wake(ids)
        run(world, 0.55)
    assert all_asleep_on_map(world)
    rows = world.rows_of(ids)
    displacement = np.linalg.norm(world.positions[rows] - before, axis=1)
    assert (displacement / (2.0 * world.radii[rows])).max() < 0.005


def test_impact_wakes_particles_that_fall_asleep_again() -> None:
    world = resting_heap()
    new = world.add([[0.05, 0.0, 1.5]], [[0.0, 0.0, -2.0]], LITRE, grow=False)
    max_awake = 0
    for _ in range(300):
        world.step(STEP)
        max_awake = max(max_awake, int((world.sleep_states == AWAKE).sum()))
    assert 2 <= max_awake < COUNT
    assert world.positions[world.rows_of(new)[0], 2] < 0.6
    run(world, 4.0)
    assert all_asleep_on_map(world)


def test_particle_that_loses_its_support_wakes_and_falls() -> None:
    world = engine()
    ids = world.add([[0, 0, 0.06], [0, 0, 0.18]], np.zeros((2, 3)), LITRE, grow=False)
    run(world, 2.0)
    assert all_asleep_on_map(world)
    world.remove(ids[:1])
    run(world, 0.2)
    assert world.positions[0, 2] < 0.1


def test_changed_ground_wakes_only_the_particles_on_it() -> None:
    world = engine()
    world.add([[0, 0, 0.06], [5.0, 0, 0.06]], np.zeros((2, 3)), LITRE, grow=False)
    run(world, 2.0)
    grid = world.ground.grid
    rows, cols = np.nonzero(
        np.hypot(grid.x(np.arange(64))[:, None], grid.y(np.arange(64))[None, :]) < 1.0
    )
    world.ground.set_heights(rows, cols, np.full(rows.size, -0.5))
    world.step(STEP)
    assert world.sleep_states.tolist() == [AWAKE, ASLEEP_ON_MAP]
    run(world, 0.5)
    assert world.positions[0, 2] < -0.3


def test_approaching_plate_wakes_and_pushes_a_heap() -> None:
    world = resting_heap()
    path = [pose(-3.0 + 0.006 * k, 0.0, 0.02) for k in range(601)]
    world.add_tool(0, [box(0.4, 0.4, 0.4)[1]], path[0])
    drive(world, path)
    assert world.positions[:, 0].max() > 0.7
    assert world.num_plate_tunnellings == 0


def test_locked_load_moves_and_weighs_as_one_body() -> None:
    world = loaded_box()
    is_locked = world.sleep_states >= FIRST_LOCKED_TOOL
    assert is_locked.mean() > 0.95
    local = world.positions_in_tool_frame(0)[is_locked]
    lifts = 0.3 * np.sin(0.004 * np.arange(400)) ** 2
    path = [BOX_POSE, *(pose(lift, 0.0, 1.0 + lift) for lift in lifts)]
    drive(world, path)
    assert num_locked(world) > 0.95 * COUNT
    moved = np.linalg.norm(world.positions_in_tool_frame(0)[is_locked] - local, axis=1)
    assert (moved < 1e-9).mean() > 0.95
    run(world, 1.0)
    force, torque = world.tool_wrench(0)
    weight = GRAVITY * float(world.masses.sum())
    assert force[2] == pytest.approx(-weight, rel=1e-3)
    arm = (world.masses[:, None] * (world.positions - path[-1][1])).sum(axis=0) * GRAVITY
    np.testing.assert_allclose(torque[:2], [-arm[1], arm[0]], atol=1e-3 * weight)


def test_locking_does_not_change_the_wrench_of_a_load() -> None:
    locked, unlocked = (
        loaded_box(allow_load_locking=locking).tool_wrench(0) for locking in (True, False)
    )
    np.testing.assert_allclose(locked[0], unlocked[0], atol=2.0)
    np.testing.assert_allclose(locked[1], unlocked[1], atol=8.0)


def test_tilt_unlocks_a_load_above_the_threshold() -> None:
    world = loaded_box()
    tilt(world, np.radians(4.0), 1.0)
    assert num_locked(world) > 0.95 * COUNT
    tilt(world, np.radians(12.0), 1.0)
    assert num_locked(world) < COUNT


def test_acceleration_unlocks_a_load() -> None:
    world = loaded_box()
    acceleration = 4.0  # m/s^2
    path = (pose(0.5 * acceleration * (STEP * k) ** 2, 0.0, 1.0) for k in range(61))
    drive(world, path)
    assert num_locked(world) == 0


def test_locking_does_not_change_the_angle_at_which_a_load_pours_out() -> None:
    half_empty_angles = []
    for allow_load_locking in (True, False):
        world = loaded_box(allow_load_locking=allow_load_locking)
        angles, fractions = np.linspace(0.0, 170.0, 800), []
        for _ in drive_steps(world, tilted(np.radians([0.0, *angles]))):
            local = world.positions_in_tool_frame(0)
            inside = (np.abs(local[:, :2]) < 0.3).all(axis=1) & (local[:, 2] < 0.6)
            fractions.append(float(inside.mean()))
        half_empty_angles.append(angles[np.argmax(np.array(fractions) < 0.5)])
        assert fractions[-1] == 0.0
        assert world.total_volume_mm3 == COUNT * (LITRE // 2)
        assert world.num_plate_tunnellings == 0
    assert abs(half_empty_angles[0] - half_empty_angles[1]) < 5.0


def test_load_falls_when_its_tool_is_removed() -> None:
    world = loaded_box()
    world.remove_tool(0)
    run(world, 0.6)
    assert world.positions[:, 2].max() < 0.7


def test_run_with_sleeping_particles_is_reproducible_bit_for_bit() -> None:
    def final_state() -> tuple[bytes, ...]:
        world = loaded_box()
        tilt(world, np.radians(40.0), 1.0)
        return (
            world.positions.tobytes(), world.velocities.tobytes(), world.sleep_states.tobytes()
        )  # fmt: skip

    assert final_state() == final_state()


def test_load_weighs_by_the_gravity_of_its_engine_after_one_with_an_integer() -> None:
    """Kernels keep the types of their first call."""
    for gravity in (10, 9.5):
        world = loaded_box(gravity=gravity)
        run(world, 0.1)
        assert (world.sleep_states >= FIRST_LOCKED_TOOL).all()
        weight = -world.tool_wrench(0)[0][2]
        assert weight == pytest.approx(gravity * float(world.masses.sum()), rel=1e-6)
