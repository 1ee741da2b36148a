"""Springs of sleeping pairs: each is restored once, and a heap woken often does not creep."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, cloud, engine

from machine_sim.dem import ParticleEngine, ParticleState
from machine_sim.dem.neighbours.history_transfer import BOTH_ASLEEP
from machine_sim.dem.neighbours.pair_table import PairTable
from machine_sim.dem.neighbours.spring_history import SpringHistory

Springs = dict[tuple[int, int], tuple[float, ...]]


def sleeping_particles(count: int) -> ParticleState:
    """Return sleeping particles with ids from 1 on, all of them in the previous pair list."""
    state = ParticleState(10**6)
    state.add(count, sleep_state=1)
    state.pair_list_row[:] = np.arange(count)
    return state


def random_pairs(count: int, rows: int) -> NDArray[np.int64]:
    """Return distinct pairs of rows in random order within each pair, shape (count, 2)."""
    rng = np.random.default_rng(3)
    number = rng.choice(rows * (rows - 1) // 2, count, replace=False)
    lower, higher = np.triu_indices(rows, 1)
    pairs = np.stack([lower[number], higher[number]], axis=1)
    reversed_order = rng.uniform(size=count) < 0.5
    pairs[reversed_order] = pairs[reversed_order, ::-1]
    return pairs


def table_of(pairs: NDArray[np.int64], spring: NDArray[np.float32], contact_flag: int) -> PairTable:
    table = PairTable(len(pairs) + 1)
    table.count = len(pairs)
    table.first[:-1], table.second[:-1] = pairs.T
    table.spring[:-1], table.contact_flag[:-1] = spring, contact_flag
    return table


def save(
    spring_history: SpringHistory, state: ParticleState, pairs: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Save random springs for some pairs, and return them."""
    spring = np.random.default_rng(len(pairs)).normal(size=(len(pairs), 3)).astype(np.float32)
    spring_history.save(state, table_of(pairs, spring, BOTH_ASLEEP), len(pairs))
    return spring


def restore(
    spring_history: SpringHistory, state: ParticleState, pairs: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Return which of some pairs get a spring back, and the springs."""
    table = table_of(pairs, np.zeros((len(pairs), 3), np.float32), 0)
    spring_history.restore(state, np.zeros(state.count, np.bool_), table)
    return table.contact_flag[:-1] == 1, table.spring[:-1]


def test_spring_is_restored_once() -> None:
    state, spring_history = sleeping_particles(100), SpringHistory()
    pairs = random_pairs(600, 100)
    spring = save(spring_history, state, pairs[:400])
    assert spring_history.count == 400
    restored, springs_back = restore(spring_history, state, pairs)
    assert restored.tolist() == [True] * 400 + [False] * 200
    np.testing.assert_array_equal(springs_back[:400], spring)
    assert spring_history.count == 0
    assert not restore(spring_history, state, pairs)[0].any()


def test_spring_is_reversed_if_the_pair_is_listed_in_reverse() -> None:
    state, spring_history = sleeping_particles(100), SpringHistory()
    pairs = random_pairs(400, 100)
    spring = save(spring_history, state, pairs)
    restored, springs_back = restore(spring_history, state, pairs[:, ::-1])
    assert restored.all()
    np.testing.assert_array_equal(springs_back, -spring)


def test_no_spring_is_lost_when_others_are_removed_and_the_table_grows() -> None:
    state, spring_history = sleeping_particles(300), SpringHistory()
    pairs = random_pairs(20_000, 300)
    first = save(spring_history, state, pairs[:700])
    restored, springs_back = restore(spring_history, state, pairs[:700:2])
    assert restored.all()
    np.testing.assert_array_equal(springs_back, first[::2])
    assert spring_history.num_slots < 4000
    second = save(spring_history, state, pairs[700:])
    assert spring_history.num_slots > 20_000
    restored, springs_back = restore(spring_history, state, pairs)
    assert np.flatnonzero(~restored).tolist() == list(range(0, 700, 2))
    np.testing.assert_array_equal(springs_back[1:700:2], first[1::2])
    np.testing.assert_array_equal(springs_back[700:], second)


def test_springs_follow_their_particles_to_new_rows() -> None:
    state, spring_history = sleeping_particles(100), SpringHistory()
    pairs = random_pairs(400, 100)
    spring = save(spring_history, state, pairs)
    order = np.random.default_rng(1).permutation(100)
    state.reorder(order)
    state.pair_list_row[:] = np.arange(100)
    restored, springs_back = restore(spring_history, state, np.argsort(order)[pairs])
    assert restored.all()
    np.testing.assert_array_equal(springs_back, spring)


def test_entries_of_removed_particles_are_dropped() -> None:
    state, spring_history = sleeping_particles(60), SpringHistory()
    for _ in range(50):
        save(spring_history, state, random_pairs(500, 60))
        state.remove(np.arange(60))
        state.add(60, sleep_state=1)
    assert spring_history.count <= spring_history.num_slots <= 1024


def test_springs_of_locked_soil_are_not_saved() -> None:
    state, spring_history = sleeping_particles(60), SpringHistory()
    state.sleep_state[:20] = 2
    pairs = random_pairs(500, 60)
    save(spring_history, state, pairs)
    assert spring_history.count == np.count_nonzero((pairs >= 20).all(axis=1))


def heap() -> ParticleEngine:
    """Return a heap that is asleep."""
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
    pytest.fail("the heap does not fall asleep")


def springs(world: ParticleEngine) -> Springs:
    """Return the springs of the listed pairs, by ids, the lower one first."""
    pairs, ids = world.neighbour_list.pairs, world.state.particle_id
    restored: Springs = {}
    for k in np.flatnonzero(pairs.contact_flag[: pairs.count]):
        i, j = int(ids[pairs.first[k]]), int(ids[pairs.second[k]])
        sign = 1.0 if i < j else -1.0
        restored[min(i, j), max(i, j)] = tuple((sign * pairs.spring[k]).tolist())
    return restored


def build(world: ParticleEngine, active: NDArray[np.bool_]) -> None:
    world.state.sleep_state[:] = ~active
    world.neighbour_list.build(world.state, np.flatnonzero(active), STEP)


def test_springs_of_a_heap_are_unchanged_after_sleep() -> None:
    world = heap()
    world.store_springs()
    all_rows = np.ones(world.count, np.bool_)
    build(world, all_rows)
    before = springs(world)
    assert len(before) > world.count
    one_row = np.arange(world.count) == 0
    build(world, one_row)
    assert len(springs(world)) < 20
    world.state.reorder(np.random.default_rng(1).permutation(world.count))
    build(world, world.state.particle_id < 200)
    assert len(springs(world)) < len(before)
    build(world, all_rows)
    assert springs(world) == before


def test_heap_that_is_woken_often_does_not_creep() -> None:
    world = heap()
    state, rng = world.state, np.random.default_rng(5)
    ids = state.particle_id.copy()
    before = state.position.copy()
    for _ in range(40):
        centre = state.position[world.rows_of(rng.choice(ids))[0]]
        world.wake_in_spheres(centre[None], np.array([0.15]))
        sleep(world)
    rows = world.rows_of(ids)
    diameter = 2.0 * state.radius[rows]
    displacement = np.linalg.norm(state.position[rows] - before, axis=1) / diameter
    # Without restored springs it is at least 0.001 diameters.
    assert np.quantile(displacement, 0.9) < 0.0004
