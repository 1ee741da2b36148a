"""Springs of pairs that rest: none is lost, none comes back twice, and a heap woken often stays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, cloud, engine

from machine_sim.particles import ParticleEngine, ParticleStore
from machine_sim.particles.pairs.dormant import DormantSprings
from machine_sim.particles.pairs.listing import RESTS
from machine_sim.particles.pairs.table import PairTable

Springs = dict[tuple[int, int], tuple[float, ...]]


def store_of(count: int) -> ParticleStore:
    """Particles at rest with ids from 1 on that were all listed before."""
    store = ParticleStore(10**6)
    store.add(count, resting=1)
    store.pair_row[:] = np.arange(count)
    return store


def some_pairs(count: int, rows: int) -> NDArray[np.int64]:
    """Pairs of rows, none twice, either of them first, shape (count, 2)."""
    rng = np.random.default_rng(3)
    number = rng.choice(rows * (rows - 1) // 2, count, replace=False)
    lower, higher = np.triu_indices(rows, 1)
    pairs = np.stack([lower[number], higher[number]], axis=1)
    turned = rng.uniform(size=count) < 0.5
    pairs[turned] = pairs[turned, ::-1]
    return pairs


def table_of(pairs: NDArray[np.int64], spring: NDArray[np.float32], touching: int) -> PairTable:
    table = PairTable(len(pairs) + 1, 0)
    table.count = len(pairs)
    table.first[:-1], table.second[:-1] = pairs.T
    table.spring[:-1], table.touching[:-1] = spring, touching
    return table


def keep(
    dormant: DormantSprings, store: ParticleStore, pairs: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Keep springs of some pairs; returns these."""
    spring = np.random.default_rng(len(pairs)).normal(size=(len(pairs), 3)).astype(np.float32)
    dormant.keep(store, table_of(pairs, spring, RESTS), len(pairs))
    return spring


def give_back(
    dormant: DormantSprings, store: ParticleStore, pairs: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Which of some pairs get a spring, and the springs."""
    table = table_of(pairs, np.zeros((len(pairs), 3), np.float32), 0)
    dormant.give_back(store, np.zeros(store.count, np.bool_), table)
    return table.touching[:-1] == 1, table.spring[:-1]


def test_a_spring_comes_back_once() -> None:
    store, dormant = store_of(100), DormantSprings()
    pairs = some_pairs(600, 100)
    spring = keep(dormant, store, pairs[:400])
    assert dormant.count == 400
    found, given = give_back(dormant, store, pairs)
    assert found.tolist() == [True] * 400 + [False] * 200
    np.testing.assert_array_equal(given[:400], spring)
    assert dormant.count == 0
    assert not give_back(dormant, store, pairs)[0].any()


def test_a_spring_is_turned_where_the_other_comes_first() -> None:
    store, dormant = store_of(100), DormantSprings()
    pairs = some_pairs(400, 100)
    spring = keep(dormant, store, pairs)
    found, given = give_back(dormant, store, pairs[:, ::-1])
    assert found.all()
    np.testing.assert_array_equal(given, -spring)


def test_none_is_lost_as_some_leave_and_the_table_grows() -> None:
    store, dormant = store_of(300), DormantSprings()
    pairs = some_pairs(20_000, 300)
    first = keep(dormant, store, pairs[:700])
    found, given = give_back(dormant, store, pairs[:700:2])
    assert found.all()
    np.testing.assert_array_equal(given, first[::2])
    assert dormant.room < 4000
    second = keep(dormant, store, pairs[700:])
    assert dormant.room > 20_000
    found, given = give_back(dormant, store, pairs)
    assert np.flatnonzero(~found).tolist() == list(range(0, 700, 2))
    np.testing.assert_array_equal(given[1:700:2], first[1::2])
    np.testing.assert_array_equal(given[700:], second)


def test_springs_follow_their_particles_to_other_rows() -> None:
    store, dormant = store_of(100), DormantSprings()
    pairs = some_pairs(400, 100)
    spring = keep(dormant, store, pairs)
    order = np.random.default_rng(1).permutation(100)
    store.reorder(order)
    store.pair_row[:] = np.arange(100)
    found, given = give_back(dormant, store, np.argsort(order)[pairs])
    assert found.all()
    np.testing.assert_array_equal(given, spring)


def test_who_is_removed_makes_room() -> None:
    store, dormant = store_of(60), DormantSprings()
    for _ in range(50):
        keep(dormant, store, some_pairs(500, 60))
        store.remove(np.arange(60))
        store.add(60, resting=1)
    assert dormant.count <= dormant.room <= 1024


def test_soil_that_rides_keeps_no_springs() -> None:
    store, dormant = store_of(60), DormantSprings()
    store.resting[:20] = 2
    pairs = some_pairs(500, 60)
    keep(dormant, store, pairs)
    assert dormant.count == np.count_nonzero((pairs >= 20).all(axis=1))


def heap() -> ParticleEngine:
    """A heap that sleeps."""
    world = engine()
    points = cloud(400, 0.1, (0.9, 0.9), 0.02)
    world.add(points, np.zeros_like(points), LITRE // 2, grow=False)
    sleep(world)
    return world


def sleep(world: ParticleEngine) -> None:
    for _ in range(2000):
        world.step(STEP)
        if (world.store.resting == 1).all():
            return
    pytest.fail("it does not fall asleep")


def springs(world: ParticleEngine) -> Springs:
    """Springs of the pairs listed, by ids, the lower one first."""
    pairs, ids = world._pairs.pairs, world.store.particle_id
    found: Springs = {}
    for k in np.flatnonzero(pairs.touching[: pairs.count]):
        i, j = int(ids[pairs.first[k]]), int(ids[pairs.second[k]])
        sign = 1.0 if i < j else -1.0
        found[min(i, j), max(i, j)] = tuple((sign * pairs.spring[k]).tolist())
    return found


def build(world: ParticleEngine, live: NDArray[np.bool_]) -> None:
    world.store.resting[:] = ~live
    world._pairs.build(world.store, np.flatnonzero(live), STEP)


def test_springs_of_a_heap_that_sleeps_and_wakes_are_as_they_were() -> None:
    world = heap()
    world._renew()
    everybody = np.ones(world.count, np.bool_)
    build(world, everybody)
    before = springs(world)
    assert len(before) > world.count
    nearly_nobody = np.arange(world.count) == 0
    build(world, nearly_nobody)
    assert len(springs(world)) < 20
    world.store.reorder(np.random.default_rng(1).permutation(world.count))
    build(world, world.store.particle_id < 200)
    assert len(springs(world)) < len(before)
    build(world, everybody)
    assert springs(world) == before


def test_a_heap_woken_here_and_there_does_not_creep() -> None:
    world = heap()
    store, rng = world.store, np.random.default_rng(5)
    ids = store.particle_id.copy()
    before = store.position.copy()
    for _ in range(40):
        spot = store.position[world.index_of(rng.choice(ids))[0]]
        world._sleep.disturb(np.array([[*spot, 0.15]]))
        sleep(world)
    rows = world.index_of(ids)
    way = np.linalg.norm(store.position[rows] - before, axis=1) / (2.0 * store.radius[rows])
    # Without their springs it is 0.001 diameters and more.
    assert np.quantile(way, 0.9) < 0.0004
