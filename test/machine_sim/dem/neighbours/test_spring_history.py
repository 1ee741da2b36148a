"""Springs of pairs that rest: none is lost, none comes back twice, and a heap woken often stays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, cloud, engine

from machine_sim.dem import ParticleEngine, ParticleState
from machine_sim.dem.neighbours.pair_search import BOTH_ASLEEP
from machine_sim.dem.neighbours.pair_table import PairTable
from machine_sim.dem.neighbours.spring_history import SpringHistory

Springs = dict[tuple[int, int], tuple[float, ...]]


def store_of(count: int) -> ParticleState:
    """Particles at rest with ids from 1 on that were all listed before."""
    state = ParticleState(10**6)
    state.add(count, sleep_state=1)
    state.pair_list_row[:] = np.arange(count)
    return state


def some_pairs(count: int, rows: int) -> NDArray[np.int64]:
    """Pairs of rows, none twice, either of them first, shape (count, 2)."""
    rng = np.random.default_rng(3)
    number = rng.choice(rows * (rows - 1) // 2, count, replace=False)
    lower, higher = np.triu_indices(rows, 1)
    pairs = np.stack([lower[number], higher[number]], axis=1)
    turned = rng.uniform(size=count) < 0.5
    pairs[turned] = pairs[turned, ::-1]
    return pairs


def table_of(pairs: NDArray[np.int64], spring: NDArray[np.float32], contact_flag: int) -> PairTable:
    table = PairTable(len(pairs) + 1, 0)
    table.count = len(pairs)
    table.first[:-1], table.second[:-1] = pairs.T
    table.spring[:-1], table.contact_flag[:-1] = spring, contact_flag
    return table


def save(
    spring_history: SpringHistory, state: ParticleState, pairs: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Keep springs of some pairs; returns these."""
    spring = np.random.default_rng(len(pairs)).normal(size=(len(pairs), 3)).astype(np.float32)
    spring_history.save(state, table_of(pairs, spring, BOTH_ASLEEP), len(pairs))
    return spring


def restore(
    spring_history: SpringHistory, state: ParticleState, pairs: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Which of some pairs get a spring, and the springs."""
    table = table_of(pairs, np.zeros((len(pairs), 3), np.float32), 0)
    spring_history.restore(state, np.zeros(state.count, np.bool_), table)
    return table.contact_flag[:-1] == 1, table.spring[:-1]


def test_a_spring_comes_back_once() -> None:
    state, spring_history = store_of(100), SpringHistory()
    pairs = some_pairs(600, 100)
    spring = save(spring_history, state, pairs[:400])
    assert spring_history.count == 400
    found, given = restore(spring_history, state, pairs)
    assert found.tolist() == [True] * 400 + [False] * 200
    np.testing.assert_array_equal(given[:400], spring)
    assert spring_history.count == 0
    assert not restore(spring_history, state, pairs)[0].any()


def test_a_spring_is_turned_where_the_other_comes_first() -> None:
    state, spring_history = store_of(100), SpringHistory()
    pairs = some_pairs(400, 100)
    spring = save(spring_history, state, pairs)
    found, given = restore(spring_history, state, pairs[:, ::-1])
    assert found.all()
    np.testing.assert_array_equal(given, -spring)


def test_none_is_lost_as_some_leave_and_the_table_grows() -> None:
    state, spring_history = store_of(300), SpringHistory()
    pairs = some_pairs(20_000, 300)
    first = save(spring_history, state, pairs[:700])
    found, given = restore(spring_history, state, pairs[:700:2])
    assert found.all()
    np.testing.assert_array_equal(given, first[::2])
    assert spring_history.num_slots < 4000
    second = save(spring_history, state, pairs[700:])
    assert spring_history.num_slots > 20_000
    found, given = restore(spring_history, state, pairs)
    assert np.flatnonzero(~found).tolist() == list(range(0, 700, 2))
    np.testing.assert_array_equal(given[1:700:2], first[1::2])
    np.testing.assert_array_equal(given[700:], second)


def test_springs_follow_their_particles_to_other_rows() -> None:
    state, spring_history = store_of(100), SpringHistory()
    pairs = some_pairs(400, 100)
    spring = save(spring_history, state, pairs)
    order = np.random.default_rng(1).permutation(100)
    state.reorder(order)
    state.pair_list_row[:] = np.arange(100)
    found, given = restore(spring_history, state, np.argsort(order)[pairs])
    assert found.all()
    np.testing.assert_array_equal(given, spring)


def test_who_is_removed_makes_room() -> None:
    state, spring_history = store_of(60), SpringHistory()
    for _ in range(50):
        save(spring_history, state, some_pairs(500, 60))
        state.remove(np.arange(60))
        state.add(60, sleep_state=1)
    assert spring_history.count <= spring_history.num_slots <= 1024


def test_soil_that_rides_keeps_no_springs() -> None:
    state, spring_history = store_of(60), SpringHistory()
    state.sleep_state[:20] = 2
    pairs = some_pairs(500, 60)
    save(spring_history, state, pairs)
    assert spring_history.count == np.count_nonzero((pairs >= 20).all(axis=1))


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
        if (world.state.sleep_state == 1).all():
            return
    pytest.fail("it does not fall asleep")


def springs(world: ParticleEngine) -> Springs:
    """Springs of the pairs listed, by ids, the lower one first."""
    pairs, ids = world.neighbour_list.pairs, world.state.particle_id
    found: Springs = {}
    for k in np.flatnonzero(pairs.contact_flag[: pairs.count]):
        i, j = int(ids[pairs.first[k]]), int(ids[pairs.second[k]])
        sign = 1.0 if i < j else -1.0
        found[min(i, j), max(i, j)] = tuple((sign * pairs.spring[k]).tolist())
    return found


def build(world: ParticleEngine, active: NDArray[np.bool_]) -> None:
    world.state.sleep_state[:] = ~active
    world.neighbour_list.build(world.state, np.flatnonzero(active), STEP)


def test_springs_of_a_heap_that_sleeps_and_wakes_are_as_they_were() -> None:
    world = heap()
    world.store_springs()
    everybody = np.ones(world.count, np.bool_)
    build(world, everybody)
    before = springs(world)
    assert len(before) > world.count
    nearly_nobody = np.arange(world.count) == 0
    build(world, nearly_nobody)
    assert len(springs(world)) < 20
    world.state.reorder(np.random.default_rng(1).permutation(world.count))
    build(world, world.state.particle_id < 200)
    assert len(springs(world)) < len(before)
    build(world, everybody)
    assert springs(world) == before


def test_a_heap_woken_here_and_there_does_not_creep() -> None:
    world = heap()
    state, rng = world.state, np.random.default_rng(5)
    ids = state.particle_id.copy()
    before = state.position.copy()
    for _ in range(40):
        spot = state.position[world.rows_of(rng.choice(ids))[0]]
        world.wake_in_spheres(spot[None], np.array([0.15]))
        sleep(world)
    rows = world.rows_of(ids)
    way = np.linalg.norm(state.position[rows] - before, axis=1) / (2.0 * state.radius[rows])
    # Without their springs it is 0.001 diameters and more.
    assert np.quantile(way, 0.9) < 0.0004
