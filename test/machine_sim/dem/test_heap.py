"""Many particles: rest, angle, release, frozen ones, repeatability."""

from itertools import pairwise

import numpy as np
import pytest
from support.particle_scenes import LITRE, STEP, box, cloud, engine, pose, run

from machine_sim.dem.materials import ContactMaterials
from msg_bridge.contract.loose_soil import LooseSoil


@pytest.fixture(scope="module")
def heap():
    """1000 particles, dropped and left alone for 4 s."""
    world = engine()
    points = cloud(1000, 0.1, (0.8, 0.8), 0.02)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    return world


def test_a_heap_comes_to_true_rest(heap):
    before = heap.state.position[np.argsort(heap.state.particle_id)].copy()
    run(heap, 1.0)
    after = heap.state.position[np.argsort(heap.state.particle_id)]
    size = 2.0 * float(heap.state.radius[0])
    weight = float(heap.state.mass.sum()) * 9.81
    assert heap.kinetic_energy < 1e-5 * weight * size
    assert np.abs(after - before).max() < 0.02 * size, "no creep"


def test_a_heap_keeps_a_plausible_angle_of_repose(heap):
    x = heap.state.position - np.median(heap.state.position, axis=0) * [1, 1, 0]
    away = np.hypot(x[:, 0], x[:, 1])
    foot = np.quantile(away, 0.95)
    edges = np.linspace(0.2, 0.9, 8) * foot
    tops = [np.sort(x[(away >= a) & (away < b), 2])[-4:].mean() for a, b in pairwise(edges)]
    slope = np.polyfit(0.5 * (edges[:-1] + edges[1:]), tops, 1)[0]
    assert 12.0 < np.degrees(np.arctan(-slope)) < 40.0


def test_a_heap_overlaps_little_and_keeps_all(heap):
    assert heap.max_overlap < 0.1
    assert heap.num_ground_tunnellings == 0
    assert heap.total_volume_mm3 == 1000 * (LITRE // 2)


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.3])
def test_an_overlapping_release_is_no_explosion(spread):
    world = engine(gravity=0.0)
    rng = np.random.default_rng(3)
    at = rng.uniform(-1, 1, (200, 3)) * spread + [0.0, 0.0, 4.0]
    world.add(at, np.zeros_like(at), LITRE // 2)
    fastest = 0.0
    for _ in range(600):
        world.step(STEP)
        fastest = max(fastest, float(np.linalg.norm(world.state.velocity, axis=1).max()))
    assert fastest < 2.0
    assert (world.state.contact_radius == world.state.radius).all(), "all grew to full size"
    assert world.max_overlap < 0.05


def test_a_frozen_particle_stays_and_carries_another():
    world = engine()
    ids = world.add([[0, 0, 1.0], [0, 0, 1.2]], np.zeros((2, 3)), LITRE, grow=False)
    world.freeze(ids[:1])
    run(world, 1.0)
    np.testing.assert_array_equal(world.state.position[0], [0, 0, 1.0])
    assert world.state.position[1, 2] == pytest.approx(1.0 + 2.0 * world.state.radius[0], rel=0.01)
    assert world.total_volume_mm3 == 2 * LITRE
    world.unfreeze(ids[:1])
    run(world, 0.2)
    assert world.state.position[0, 2] < 0.99


@pytest.mark.parametrize("before", [0.0, 0.02])
def test_frozen_particles_do_not_grow_into_one_another(before):
    world = engine(gravity=0.0)
    points = np.random.default_rng(3).uniform([-0.1, -0.1, 3.9], [0.1, 0.1, 4.1], (60, 3))
    ids = world.add(points, np.zeros_like(points), LITRE // 2)
    far = world.add([[3.0, 0.0, 4.0]], np.zeros((1, 3)), LITRE // 2)
    run(world, before)
    world.freeze(ids)
    run(world, 0.3)
    row = world.rows_of(far)[0]
    assert world.state.contact_radius[row] == world.state.radius[row]
    world.unfreeze(ids)
    fastest = 0.0
    for _ in range(400):
        world.step(STEP)
        fastest = max(fastest, float(np.linalg.norm(world.state.velocity, axis=1).max()))
    assert fastest < 2.0
    assert (world.state.contact_radius == world.state.radius).all(), "they grow once let go"


def test_removing_others_does_not_disturb_a_heap_at_rest():
    world = engine()
    points = cloud(200, 0.1, (0.5, 0.5), 0.02)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 3.0)
    far = world.add([[5, 5, 3], [5, 5, 4]], np.zeros((2, 3)), LITRE, grow=False)
    world.step(STEP)
    world.remove(far[:1])
    world.step(STEP)
    heap = world.state.particle_id < far[0]
    assert np.abs(world.state.velocity[heap]).max() < 1e-3, "tangential springs were kept"


def test_a_rerun_is_identical_to_the_bit():
    def state():
        world = engine()
        points = cloud(300, 0.07, (0.4, 0.4), 0.3)
        ids = world.add(points, np.zeros_like(points), LITRE // 2)
        run(world, 0.4)
        world.remove(ids[::7])
        world.freeze(ids[1::7])
        run(world, 0.4)
        state = world.state
        return state.position.tobytes(), state.velocity.tobytes(), state.particle_id.tobytes()

    assert state() == state()


def test_reordering_rows_keeps_the_contacts():
    worlds = [engine(), engine()]
    points = cloud(100, 0.1, (0.4, 0.4), 0.02)
    for world in worlds:
        world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
        run(world, 0.5)
    worlds[1].state.reorder(np.random.default_rng(0).permutation(100))
    worlds[1]._pairs.is_stale = True
    for world in worlds:
        world.step(STEP)
    a, b = (w.state.velocity[np.argsort(w.state.particle_id)] for w in worlds)
    np.testing.assert_allclose(a, b, atol=2e-4)


@pytest.mark.parametrize("angle", [20.0, 30.0, 40.0])
def test_poured_soil_takes_the_room_its_packing_says(angle):
    world = engine(soils=[LooseSoil(0.25, repose_angles=(angle, angle, angle))])
    world.add_tool(0, box(1.2, 1.2, 4.0), pose())
    points = cloud(2500, 0.12, (1.0, 1.0), 0.06)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    center, radius = world.state.position, float(world.state.radius[0])
    top = np.sort(center[:, 2])[-60]
    probe = np.random.default_rng(0).uniform([-0.4, -0.4, 0.2], [0.4, 0.4, top - 0.2], (16_000, 3))
    filled = sum(
        int((((part[:, None] - center) ** 2).sum(axis=2).min(axis=1) < radius**2).sum())
        for part in np.split(probe, 32)
    )
    assert filled / len(probe) == pytest.approx(
        ContactMaterials(world.soils, LITRE).packing[0, 0], rel=0.04
    )
