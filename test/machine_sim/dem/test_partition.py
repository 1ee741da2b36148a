"""Parts of the pair list: all pairs once, no particle shared by two that go at once."""

import numpy as np
import pytest
from numba.core.config import NUMBA_NUM_THREADS
from support.particle_scenes import LITRE, STEP, box, cloud, engine, pose, run

from machine_sim.dem.partition import partition_pairs


def slabs_of(sizes):
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


@pytest.mark.parametrize("boundary_slabs", [1, 2])
def test_regions_share_out_the_pairs(boundary_slabs):
    slabs = slabs_of([2000] * 60)
    bounds = partition_pairs(slabs, boundary_slabs)
    assert bounds[0] == 0
    assert bounds[-1] == slabs[-1]
    assert bounds.size == 2 * 8
    work = np.diff(bounds)
    assert (work[1::2] == 2000 * boundary_slabs).all()
    assert work[::2].min() > 0.5 * slabs[-1] / 8
    assert np.isin(bounds, slabs).all()


def test_a_short_list_is_one_region():
    assert partition_pairs(slabs_of([100] * 50), 1).tolist() == [0, 5000]
    assert partition_pairs(slabs_of([]), 1).tolist() == [0, 0]


@pytest.mark.parametrize("boundary_slabs", [1, 2])
@pytest.mark.parametrize("slabs", [1, 2, 3, 4, 7])
def test_few_slabs_are_cut_only_where_regions_stay_apart(slabs, boundary_slabs):
    of_slab = slabs_of([30_000] * slabs)
    bounds = partition_pairs(of_slab, boundary_slabs)
    at = np.searchsorted(of_slab, bounds)
    assert (np.diff(at)[1:-1] >= boundary_slabs).all()
    assert bounds[-1] == 30_000 * slabs


def many(threads):
    """12 000 particles that fall to a long heap, and into a box that is pushed through it."""
    world = engine(capacity=20_000, threads=threads)
    points = cloud(12_000, 0.1, (2.0, 4.0), 0.1)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    at = pose(0.0, 0.0, 0.4)
    world.add_tool(0, box(0.8, 0.8, 0.5), at)
    for k in range(40):
        to = pose(0.0, 0.0, 0.4 - 0.002 * (k + 1), 0.005 * (k + 1))
        world.set_tool_motion(0, at, to)
        world.step(STEP)
        at = to
    return world


def shared(world, parts):
    """How often two of the parts touch the same particle."""
    pairs = world._pairs.pairs
    count = np.zeros(world.count, np.int64)
    for part in parts:
        of = slice(int(pairs.bounds[part]), int(pairs.bounds[part + 1]))
        count[np.union1d(pairs.first[of], pairs.second[of])] += 1
    return int((count > 1).sum())


def check_apart(world):
    parts = world._pairs.pairs.bounds.size - 1
    assert parts >= 3
    assert shared(world, range(0, parts, 2)) == 0
    assert shared(world, range(1, parts, 2)) == 0


@pytest.fixture(scope="module")
def one():
    return many(1)


def test_parts_that_go_at_once_share_no_particle(one):
    check_apart(one)


def test_nor_do_they_where_few_are_awake():
    world = many(1)
    # All but some everywhere rest; those are listed with both slabs beside them.
    world.state.sleep_state[np.arange(world.count) % 5 > 1] = 1
    world._pairs.is_stale = True
    world.step(0.005)
    assert 2 * np.count_nonzero(world.state.sleep_state == 0) < world.count
    check_apart(world)


more_threads = pytest.mark.skipif(
    NUMBA_NUM_THREADS < 2, reason="one core: it would be compared with itself"
)


@more_threads
def test_two_threads_give_the_same_bits(one):
    two = many(2)
    assert two.params.threads == 2
    assert two._pairs.pairs.bounds.size > 2
    for name in ("position", "velocity", "angular_velocity"):
        assert np.array_equal(getattr(one.state, name), getattr(two.state, name)), name


@more_threads
def test_nor_do_they_differ_where_some_rest_and_wake():
    worlds = [many(1), many(2)]
    for world in worlds:
        for rests in (0, 2, 1):
            # Springs are kept, then given back.
            world.state.sleep_state[:] = world.state.particle_id % 5 < rests
            world._pairs.is_stale = world._records_stale = True
            run(world, 0.01)
            if rests == 2:
                assert world._pairs.spring_history.count > 500
    for name in ("position", "velocity", "angular_velocity"):
        assert np.array_equal(*(getattr(world.state, name) for world in worlds)), name
