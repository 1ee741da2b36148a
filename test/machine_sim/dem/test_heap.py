"""Heaps of particles: rest, angle of repose, packing, release, frozen particles, repeatability."""

from itertools import pairwise

import numpy as np
import pytest
from support.particle_scenes import LITRE, STEP, box, cloud, engine, pose, run

from machine_sim.dem.materials import ContactMaterials
from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.loose_soil import LooseSoil


@pytest.fixture(scope="module")
def heap():
    """1000 particles, dropped and undisturbed for 4 s."""
    world = engine()
    points = cloud(1000, 0.1, (0.8, 0.8), 0.02)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    return world


def test_heap_comes_to_rest_and_does_not_creep(heap):
    before = heap.positions[np.argsort(heap.ids)].copy()
    run(heap, 1.0)
    after = heap.positions[np.argsort(heap.ids)]
    size = 2.0 * float(heap.radii[0])
    weight = float(heap.masses.sum()) * GRAVITY
    assert heap.kinetic_energy < 1e-5 * weight * size
    assert np.abs(after - before).max() < 0.02 * size


def test_heap_has_a_plausible_angle_of_repose(heap):
    x = heap.positions - np.median(heap.positions, axis=0) * [1, 1, 0]
    distance = np.hypot(x[:, 0], x[:, 1])
    edges = np.linspace(0.2, 0.9, 8) * np.quantile(distance, 0.95)
    tops = [np.sort(x[(distance >= a) & (distance < b), 2])[-4:].mean() for a, b in pairwise(edges)]
    slope = np.polyfit(0.5 * (edges[:-1] + edges[1:]), tops, 1)[0]
    assert 12.0 < np.degrees(np.arctan(-slope)) < 40.0


def test_particles_in_a_heap_overlap_little_and_none_is_lost(heap):
    assert heap.max_overlap < 0.1
    assert heap.num_ground_tunnellings == 0
    assert heap.total_volume_mm3 == 1000 * (LITRE // 2)


def max_speed(world, steps):
    """Step an engine and return the maximum speed of a particle [m/s]."""
    speed = 0.0
    for _ in range(steps):
        world.step(STEP)
        speed = max(speed, float(np.linalg.norm(world.velocities, axis=1).max()))
    return speed


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.3])
def test_overlapping_release_does_not_explode(spread):
    world = engine(gravity=0.0)
    points = np.random.default_rng(3).uniform(-1, 1, (200, 3)) * spread + [0.0, 0.0, 4.0]
    world.add(points, np.zeros_like(points), LITRE // 2)
    assert max_speed(world, 600) < 2.0
    assert (world.contact_radii == world.radii).all(), "not all grew to full size"
    assert world.max_overlap < 0.05


def test_frozen_particle_stays_and_supports_another():
    world = engine()
    ids = world.add([[0, 0, 1.0], [0, 0, 1.2]], np.zeros((2, 3)), LITRE, grow=False)
    world.freeze(ids[:1])
    run(world, 1.0)
    np.testing.assert_array_equal(world.positions[0], [0, 0, 1.0])
    assert world.positions[1, 2] == pytest.approx(1.0 + 2.0 * world.radii[0], rel=0.01)
    assert world.total_volume_mm3 == 2 * LITRE
    world.unfreeze(ids[:1])
    run(world, 0.2)
    assert world.positions[0, 2] < 0.99


@pytest.mark.parametrize("growth_before_freezing", [0.0, 0.02])
def test_frozen_particles_do_not_grow_into_one_another(growth_before_freezing):
    world = engine(gravity=0.0)
    points = np.random.default_rng(3).uniform([-0.1, -0.1, 3.9], [0.1, 0.1, 4.1], (60, 3))
    ids = world.add(points, np.zeros_like(points), LITRE // 2)
    distant = world.add([[3.0, 0.0, 4.0]], np.zeros((1, 3)), LITRE // 2)
    run(world, growth_before_freezing)
    world.freeze(ids)
    run(world, 0.3)
    row = world.rows_of(distant)[0]
    assert world.contact_radii[row] == world.radii[row]
    world.unfreeze(ids)
    assert max_speed(world, 400) < 2.0
    assert (world.contact_radii == world.radii).all(), "they do not grow once unfrozen"


def test_removing_distant_particles_does_not_disturb_a_heap_at_rest():
    world = engine()
    points = cloud(200, 0.1, (0.5, 0.5), 0.02)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 3.0)
    distant = world.add([[5, 5, 3], [5, 5, 4]], np.zeros((2, 3)), LITRE, grow=False)
    world.step(STEP)
    world.remove(distant[:1])
    world.step(STEP)
    assert np.abs(world.velocities[world.ids < distant[0]]).max() < 1e-3, "springs were lost"


def test_run_is_reproducible_bit_for_bit():
    def final_state():
        world = engine()
        points = cloud(300, 0.07, (0.4, 0.4), 0.3)
        ids = world.add(points, np.zeros_like(points), LITRE // 2)
        run(world, 0.4)
        world.remove(ids[::7])
        world.freeze(ids[1::7])
        run(world, 0.4)
        return world.positions.tobytes(), world.velocities.tobytes(), world.ids.tobytes()

    assert final_state() == final_state()


def test_sorting_rows_keeps_the_contacts():
    worlds = [engine(), engine()]
    points = np.random.default_rng(0).permutation(cloud(100, 0.1, (0.4, 0.4), 0.02))
    for world in worlds:
        world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
        run(world, 0.5)
    worlds[1].sort_rows()
    assert (np.diff(worlds[1].ids.astype(int)) < 0).any(), "the order of rows did not change"
    for world in worlds:
        world.step(STEP)
    a, b = (world.velocities[np.argsort(world.ids)] for world in worlds)
    np.testing.assert_allclose(a, b, atol=2e-4)


@pytest.mark.parametrize("repose_angle", [20.0, 30.0, 40.0])
def test_poured_soil_has_its_packing_fraction(repose_angle):
    world = engine(soils=[LooseSoil(0.25, repose_angles=(repose_angle,) * 3)])
    world.add_tool(0, box(1.2, 1.2, 4.0), pose())
    points = cloud(2500, 0.12, (1.0, 1.0), 0.06)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    run(world, 4.0)
    centres, radius = world.positions, float(world.radii[0])
    top = np.sort(centres[:, 2])[-60]
    probes = np.random.default_rng(0).uniform([-0.4, -0.4, 0.2], [0.4, 0.4, top - 0.2], (16_000, 3))
    num_filled = sum(
        int((((part[:, None] - centres) ** 2).sum(axis=2).min(axis=1) < radius**2).sum())
        for part in np.split(probes, 32)
    )
    assert num_filled / len(probes) == pytest.approx(
        ContactMaterials(world.soils, LITRE).packing[0, 0], rel=0.04
    )


def test_more_substeps_than_a_collision_lasts_are_an_error():
    with pytest.raises(ParameterError, match="substeps_per_contact"):
        engine(substeps=8, substeps_per_contact=5.6)


def test_fine_substeps_of_as_long_collisions_do_not_burst_a_heap():
    world = engine(substeps=16, substeps_per_contact=22.4)
    points = cloud(200, 0.13, (0.6, 0.6), 1.0)
    world.add(points, np.zeros_like(points), LITRE, grow=False)
    fastest = 0.0
    for _ in range(200):
        world.step(STEP)
        fastest = max(fastest, float(np.linalg.norm(world.state.velocity, axis=1).max()))
    assert fastest < 9.0, "free fall from the top of the cloud, 3.5 m: 8.3 m/s"
