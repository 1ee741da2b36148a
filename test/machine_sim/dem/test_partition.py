"""Parts of the pair list: each pair in one part, no particle in two parts that run together."""

import numpy as np
import pytest
from numba.core.config import NUMBA_NUM_THREADS
from support.particle_scenes import LITRE, STEP, box, cloud, drive, engine, pose, run

from machine_sim.dem.partition import partition_pairs


def first_pairs(pairs_per_slab):
    """Return the first pair of each slab, and the end."""
    return np.concatenate([[0], np.cumsum(pairs_per_slab)]).astype(np.int64)


@pytest.mark.parametrize("slabs_per_boundary", [1, 2])
def test_regions_have_about_the_same_number_of_pairs(slabs_per_boundary):
    slabs = first_pairs([2000] * 60)
    bounds = partition_pairs(slabs, slabs_per_boundary)
    assert bounds[0] == 0
    assert bounds[-1] == slabs[-1]
    assert len(bounds) == 2 * 8
    num_pairs = np.diff(bounds)
    assert (num_pairs[1::2] == 2000 * slabs_per_boundary).all()
    assert num_pairs[::2].min() > 0.5 * slabs[-1] / 8
    assert np.isin(bounds, slabs).all()


def test_short_list_is_one_region():
    assert partition_pairs(first_pairs([100] * 50), 1) == [0, 5000]
    assert partition_pairs(first_pairs([]), 1) == [0, 0]


@pytest.mark.parametrize("slabs_per_boundary", [1, 2])
@pytest.mark.parametrize("num_slabs", [1, 2, 3, 4, 7])
def test_regions_of_few_slabs_stay_apart(num_slabs, slabs_per_boundary):
    slabs = first_pairs([30_000] * num_slabs)
    bounds = partition_pairs(slabs, slabs_per_boundary)
    slab_of_bound = np.searchsorted(slabs, bounds)
    assert (np.diff(slab_of_bound)[1:-1] >= slabs_per_boundary).all()
    assert bounds[-1] == 30_000 * num_slabs


def large_scene(threads):
    """Return 12 000 particles that fall on a long heap, and a box that is pushed through it."""
    world = engine(capacity=20_000, threads=threads)
    points = cloud(12_000, 0.1, (2.0, 4.0), 0.1)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    path = [pose(0.0, 0.0, 0.4 - 0.002 * k, 0.005 * k) for k in range(41)]
    world.add_tool(0, box(0.8, 0.8, 0.5), path[0])
    drive(world, path)
    return world


def num_shared(world, parts):
    """Return the number of particles in more than one of some parts of the pair list."""
    pairs = world.neighbour_list.pairs
    count = np.zeros(world.count, np.int64)
    for part in parts:
        rows = slice(int(pairs.bounds[part]), int(pairs.bounds[part + 1]))
        count[np.union1d(pairs.first[rows], pairs.second[rows])] += 1
    return int((count > 1).sum())


def assert_independent_parts(world):
    num_parts = world.neighbour_list.pairs.bounds.size - 1
    assert num_parts >= 3
    assert num_shared(world, range(0, num_parts, 2)) == 0
    assert num_shared(world, range(1, num_parts, 2)) == 0


@pytest.fixture(scope="module")
def serial_scene():
    return large_scene(1)


def test_parts_that_run_at_the_same_time_share_no_particle(serial_scene):
    assert_independent_parts(serial_scene)


def test_parts_of_a_sparse_list_share_no_particle():
    world = large_scene(1)
    # Fewer than half of the particles, everywhere, are active: pairs reach into both slabs beside.
    world.freeze(world.ids[np.arange(world.count) % 5 > 1])
    world.unfreeze(world.frozen_ids[:1])
    world.step(STEP)
    assert 2 * world.frozen_ids.size > world.count
    assert_independent_parts(world)


more_threads = pytest.mark.skipif(
    NUMBA_NUM_THREADS < 2, reason="one core: it would be compared with itself"
)


def assert_same_motion(one, two):
    for name in ("positions", "velocities", "angular_velocities"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name


@more_threads
def test_two_threads_give_the_same_bits(serial_scene):
    two = large_scene(2)
    assert two.params.threads == 2
    assert two.neighbour_list.pairs.bounds.size > 2
    assert_same_motion(serial_scene, two)


@more_threads
def test_two_threads_give_the_same_bits_where_particles_stop_and_move_again():
    worlds = [large_scene(1), large_scene(2)]
    for world in worlds:
        for num_stopped in (2, 1):
            # Springs of stopped pairs are saved, then restored.
            world.unfreeze(world.frozen_ids)
            world.freeze(world.ids[world.ids % 5 < num_stopped])
            world.unfreeze(world.frozen_ids[:1])
            run(world, 0.01)
            if num_stopped == 2:
                assert world.neighbour_list.spring_history.count > 500
    assert_same_motion(*worlds)
