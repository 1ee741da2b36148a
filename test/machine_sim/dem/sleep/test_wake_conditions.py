"""Nobody sleeps who should not: support that leaves, slow pushes, loads that go down."""

from __future__ import annotations

import numpy as np
import pytest
from support.particle_scenes import LITRE, STEP, box, cloud, engine, pose, run, square

from machine_sim.dem import ParticleEngine, Pose


def go(world: ParticleEngine, at: Pose, to: Pose, seconds: float) -> None:
    """Move tool 0 from one place to another, softly."""
    steps = round(seconds / STEP)
    before = at
    for k in range(steps):
        share = (k + 1) / steps
        share *= share * (3.0 - 2.0 * share)
        after = (at[0], at[1] + share * (to[1] - at[1]))
        world.set_tool_motion(0, before, after)
        world.step(STEP)
        before = after


def hanging(world: ParticleEngine) -> int:
    """How many of those on the map rest on nothing: neither ground nor plates nor each other."""
    state = world.state
    position, radius = state.position, state.radius.astype(float)
    ground = np.array([world.ground.height(x, y) for x, y, _ in position])
    held = (position[:, 2] - ground < 1.6 * radius) | (state.sleep_state != 1)
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    near = distance < 1.1 * (radius[:, None] + radius[None])
    for _ in range(len(position)):
        held |= near[held].any(axis=0)
    return int((~held).sum())


def heap(count: int = 300, **params: float) -> ParticleEngine:
    world = engine(**params)
    points = cloud(count, 0.1, (0.6, 0.6), 0.02)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    return world


def test_a_stack_goes_down_with_the_shelf_it_lies_on() -> None:
    world = engine()
    world.add_tool(0, [square(0.3)], pose(z=1.0), is_digging=False)
    r = 0.0564
    cells = [(x, y, k) for k in range(3) for x in (-2, 0, 2) for y in (-2, 0, 2)]
    points = [[x * r, y * r, 1.0 + r * (1 + 2 * k)] for x, y, k in cells]
    world.add(points, np.zeros((27, 3)), LITRE, grow=False)
    run(world, 3.0)
    assert (world.state.sleep_state != 0).all()
    go(world, pose(z=1.0), pose(z=0.3), 0.5)
    run(world, 1.0)
    assert world.state.position[:, 2].max() < 0.8


@pytest.mark.parametrize("depth", [0.01, 0.2, 1.0])
def test_ground_dug_away_leaves_nobody_hanging(depth: float) -> None:
    world = heap()
    run(world, 5.0)
    grid = world.ground.grid
    rows = np.flatnonzero((grid.x(np.arange(64)) > 0.2) & (grid.x(np.arange(64)) < 3.0))
    at = np.repeat(rows, 64), np.tile(np.arange(64), rows.size)
    world.ground.set_heights(*at, np.full(at[0].size, -depth))
    run(world, 1.5)
    assert hanging(world) == 0


def test_who_lands_leaves_nobody_hanging() -> None:
    world = heap()
    run(world, 5.0)
    for _ in range(30):
        ids = world.settled()[:5]
        world.freeze(ids)
        run(world, 0.01)
        world.remove(ids)
        run(world, 0.05)
    assert world.count < 250
    assert hanging(world) == 0


@pytest.mark.parametrize("speed", [0.02, 0.04])
def test_a_slow_push_is_no_blow(speed: float) -> None:
    forces, fastest = {}, 0.0
    for allow_sleeping in (True, False):
        world = heap(200, allow_sleeping=allow_sleeping)
        world.add_tool(0, [square(0.6)], pose(-1.2, 0.0, 0.602, np.pi / 2))
        run(world, 4.0)
        x = float(world.state.position[:, 0].min()) - 0.1
        at = pose(x, 0.0, 0.602, np.pi / 2)
        force = 0.0
        for k in range(round(0.3 / speed / STEP)):
            to = pose(x + speed * STEP * (k + 1), 0.0, 0.602, np.pi / 2)
            world.set_tool_motion(0, at, to)
            world.step(STEP)
            at = to
            force = max(force, float(np.linalg.norm(world.tool_wrench(0)[0])))
            if allow_sleeping:
                fastest = max(fastest, float(np.linalg.norm(world.state.velocity, axis=1).max()))
        forces[allow_sleeping] = force
    assert forces[False] > 0.0
    assert forces[True] < 3.0 * forces[False]
    assert fastest < 0.5


@pytest.mark.parametrize("allow_load_locking", [True, False])
@pytest.mark.parametrize("speed", [0.1, 0.5])
def test_a_heaped_box_takes_its_heap_down(allow_load_locking: bool, speed: float) -> None:
    world = engine(allow_load_locking=allow_load_locking)
    world.add_tool(0, box(1.0, 1.0, 0.2), pose(z=1.0))
    points = cloud(500, 0.1, (0.8, 0.8), 1.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 5.0)
    world.remove(world.state.particle_id[world.state.position[:, 2] < 1.0])
    run(world, 1.5)
    count, top = world.count, np.sort(world.positions_in_tool_frame(0)[:, 2])[-20:].mean()
    assert top > 0.25, "heaped"
    go(world, pose(z=1.0), pose(z=0.5), 0.5 / speed)
    assert world.count == count
    assert hanging(world) == 0
    assert np.sort(world.positions_in_tool_frame(0)[:, 2])[-20:].mean() == pytest.approx(
        top, abs=0.05
    )


@pytest.mark.parametrize("allow_load_locking", [True, False])
def test_a_tube_without_a_floor_takes_nothing_along(allow_load_locking: bool) -> None:
    world = engine(allow_load_locking=allow_load_locking)
    world.add_tool(0, box(0.6, 0.6, 0.6)[1:], pose(), is_digging=False)
    points = cloud(100, 0.1, (0.45, 0.45), 0.06)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 3.0)
    go(world, pose(), pose(z=1.5), 4.0)
    assert world.state.position[:, 2].max() < 0.5


def test_a_tool_added_elsewhere_changes_nothing_for_a_load() -> None:
    world = engine()
    world.add_tool(0, box(0.6, 0.6, 0.6), pose(z=1.0))
    points = cloud(100, 0.1, (0.45, 0.45), 1.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    assert (world.state.sleep_state == 2).mean() > 0.9
    at = pose(z=1.0)
    for tilt in np.radians([4.0, 8.0, 12.0, 16.0]):
        for k in range(20):
            to = pose(z=1.0, pitch=tilt - np.radians(4.0) * (1.0 - (k + 1) / 20))
            world.set_tool_motion(0, at, to)
            world.step(STEP)
            at = to
        world.add_tool(10 + round(1e3 * tilt), [square(0.1)], pose(50.0, 0.0, 50.0))
    assert (world.state.sleep_state == 2).sum() == 0


def test_a_load_that_meets_a_shelf_is_no_load_any_more() -> None:
    world = engine()
    world.add_tool(0, box(0.6, 0.6, 0.3), pose(z=1.0))
    world.add_tool(1, [square(0.2)], pose(z=1.6), is_digging=False)
    points = cloud(140, 0.1, (0.45, 0.45), 1.05)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    assert (world.state.sleep_state == 2).sum() > 60
    go(world, pose(z=1.0), pose(z=1.45), 2.0)
    assert (world.state.sleep_state == 2).sum() == 0
    assert world.num_plate_tunnellings == 0
