"""Wake conditions: no particle sleeps after its support was removed."""

from __future__ import annotations

import numpy as np
import pytest
from support.particle_scenes import (
    LITRE,
    STEP,
    box,
    cloud,
    drive,
    drive_steps,
    engine,
    pose,
    run,
    square,
)

from machine_sim.dem import ParticleEngine, Pose
from machine_sim.dem.sleep import ASLEEP_ON_MAP, AWAKE, locked_state


def move_smoothly(world: ParticleEngine, start: Pose, end: Pose, seconds: float) -> None:
    """Move tool 0 from start to end without a jump of its velocity."""
    fraction = np.linspace(0.0, 1.0, round(seconds / STEP) + 1)
    fraction *= fraction * (3.0 - 2.0 * fraction)
    drive(world, ((start[0], start[1] + f * (end[1] - start[1])) for f in fraction))


def num_unsupported(world: ParticleEngine) -> int:
    """Return the number of particles asleep on the map that no chain of contacts supports."""
    positions, radii = world.positions, world.radii.astype(float)
    ground = np.array([world.ground.height(x, y) for x, y, _ in positions])
    supported = (positions[:, 2] - ground < 1.6 * radii) | (world.sleep_states != ASLEEP_ON_MAP)
    distance = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    near = distance < 1.1 * (radii[:, None] + radii[None])
    for _ in range(len(positions)):
        supported |= near[supported].any(axis=0)
    return int((~supported).sum())


def heap(count: int = 300, **params: float) -> ParticleEngine:
    world = engine(**params)
    points = cloud(count, 0.1, (0.6, 0.6), 0.02)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    return world


def test_sleeping_stack_follows_the_shelf_it_lies_on() -> None:
    world = engine()
    world.add_tool(0, [square(0.3)], pose(z=1.0), is_digging=False)
    r = 0.0564
    cells = [(x, y, k) for k in range(3) for x in (-2, 0, 2) for y in (-2, 0, 2)]
    points = [[x * r, y * r, 1.0 + r * (1 + 2 * k)] for x, y, k in cells]
    world.add(points, np.zeros((27, 3)), LITRE, grow=False)
    run(world, 3.0)
    assert (world.sleep_states != AWAKE).all()
    move_smoothly(world, pose(z=1.0), pose(z=0.3), 0.5)
    run(world, 1.0)
    assert world.positions[:, 2].max() < 0.8


@pytest.mark.parametrize("depth", [0.01, 0.2, 1.0])
def test_no_particle_sleeps_over_excavated_ground(depth: float) -> None:
    world = heap()
    run(world, 5.0)
    x = world.ground.grid.x(np.arange(64))
    rows = np.flatnonzero((x > 0.2) & (x < 3.0))
    cells = np.repeat(rows, 64), np.tile(np.arange(64), rows.size)
    world.ground.set_heights(*cells, np.full(cells[0].size, -depth))
    run(world, 1.5)
    assert num_unsupported(world) == 0


def test_no_particle_sleeps_over_those_that_landed() -> None:
    world = heap()
    run(world, 5.0)
    for _ in range(30):
        ids = world.settled()[:5]
        world.freeze(ids)
        run(world, 0.01)
        world.remove(ids)
        run(world, 0.05)
    assert world.count < 250
    assert num_unsupported(world) == 0


@pytest.mark.parametrize("speed", [0.02, 0.04])
def test_slow_push_on_sleeping_soil_is_no_impact(speed: float) -> None:
    max_forces, max_speed = {}, 0.0
    for allow_sleeping in (True, False):
        world = heap(200, allow_sleeping=allow_sleeping)
        world.add_tool(0, [square(0.6)], pose(-1.2, 0.0, 0.602, np.pi / 2))
        run(world, 4.0)
        x = float(world.positions[:, 0].min()) - 0.1
        steps = np.arange(round(0.3 / speed / STEP) + 1)
        max_force = 0.0
        for _ in drive_steps(
            world, (pose(x + speed * STEP * k, 0.0, 0.602, np.pi / 2) for k in steps)
        ):
            max_force = max(max_force, float(np.linalg.norm(world.tool_wrench(0)[0])))
            if allow_sleeping:
                max_speed = max(max_speed, float(np.linalg.norm(world.velocities, axis=1).max()))
        max_forces[allow_sleeping] = max_force
    assert max_forces[False] > 0.0
    assert max_forces[True] < 3.0 * max_forces[False]
    assert max_speed < 0.5


@pytest.mark.parametrize("allow_load_locking", [True, False])
@pytest.mark.parametrize("speed", [0.1, 0.5])
def test_heap_on_a_box_descends_with_the_box(allow_load_locking: bool, speed: float) -> None:
    def top_height() -> float:
        return float(np.sort(world.positions_in_tool_frame(0)[:, 2])[-20:].mean())

    world = engine(allow_load_locking=allow_load_locking)
    world.add_tool(0, box(1.0, 1.0, 0.2), pose(z=1.0))
    points = cloud(500, 0.1, (0.8, 0.8), 1.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 5.0)
    world.remove(world.ids[world.positions[:, 2] < 1.0])
    run(world, 1.5)
    count, top = world.count, top_height()
    assert top > 0.25, "not heaped"
    move_smoothly(world, pose(z=1.0), pose(z=0.5), 0.5 / speed)
    assert world.count == count
    assert num_unsupported(world) == 0
    assert top_height() == pytest.approx(top, abs=0.05)


@pytest.mark.parametrize("allow_load_locking", [True, False])
def test_tube_without_floor_lifts_no_soil(allow_load_locking: bool) -> None:
    world = engine(allow_load_locking=allow_load_locking)
    world.add_tool(0, box(0.6, 0.6, 0.6)[1:], pose(), is_digging=False)
    points = cloud(100, 0.1, (0.45, 0.45), 0.06)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 3.0)
    move_smoothly(world, pose(), pose(z=1.5), 4.0)
    assert world.positions[:, 2].max() < 0.5


def num_locked_to_first_tool(world: ParticleEngine) -> int:
    return int((world.sleep_states == locked_state(0)).sum())


def test_adding_distant_tools_does_not_reset_the_tilt_of_a_load() -> None:
    world = engine()
    world.add_tool(0, box(0.6, 0.6, 0.6), pose(z=1.0))
    points = cloud(100, 0.1, (0.45, 0.45), 1.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    assert num_locked_to_first_tool(world) > 90
    for k in range(4):
        angles = np.radians(np.linspace(4.0 * k, 4.0 * (k + 1), 21))
        drive(world, (pose(z=1.0, pitch=angle) for angle in angles))
        world.add_tool(10 + k, [square(0.1)], pose(50.0, 0.0, 50.0))
    assert num_locked_to_first_tool(world) == 0


def test_load_that_touches_another_tool_is_unlocked() -> None:
    world = engine()
    world.add_tool(0, box(0.6, 0.6, 0.3), pose(z=1.0))
    world.add_tool(1, [square(0.2)], pose(z=1.6), is_digging=False)
    points = cloud(140, 0.1, (0.45, 0.45), 1.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    assert num_locked_to_first_tool(world) > 60
    move_smoothly(world, pose(z=1.0), pose(z=1.45), 2.0)
    assert num_locked_to_first_tool(world) == 0
    assert world.num_plate_tunnellings == 0
