"""The neighbour list against brute force: nobody is missed, nobody listed twice."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, cloud, engine

from machine_sim.dem import ParticleEngine


def scene(seed: int) -> ParticleEngine:
    """Particles of many sizes, sleepers among them, some strays far away."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 300))
    world = engine(gravity=0.0)
    at = rng.normal(size=(count, 3)) * rng.uniform(0.1, 1.5) + [0.0, 0.0, 5.0]
    at[: rng.integers(0, 3)] *= 10.0 ** rng.uniform(0, 4)
    volume = (LITRE * 10.0 ** rng.uniform(-3, 0.6, count)).astype(np.int64)
    speed = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-3, 1)
    world.add(at, speed, volume, grow=False)
    return world


def listed(world: ParticleEngine) -> list[tuple[int, int]]:
    pairs = world.neighbour_list.pairs
    both = np.stack([pairs.first[: pairs.count], pairs.second[: pairs.count]], axis=1)
    return [tuple(pair) for pair in np.sort(both.astype(np.int64), axis=1).tolist()]


def touching(
    position: NDArray[np.float64], radius: NDArray[np.float32], live: NDArray[np.bool_]
) -> set[tuple[int, int]]:
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    sums = radius.astype(float)[:, None] + radius[None]
    near = distance < 1.03 * sums
    near &= live[:, None] | live[None]
    return {(int(i), int(j)) for i, j in zip(*np.nonzero(near), strict=True) if i < j}


@pytest.mark.parametrize("seed", range(40))
def test_all_who_touch_are_listed_once(seed: int) -> None:
    world = scene(seed)
    state = world.state
    asleep = np.random.default_rng(seed + 1000).uniform(size=world.count) < (seed % 4) / 3.2
    asleep[0] = False
    state.sleep_state[asleep] = 1
    state.velocity[asleep] = 0.0
    live = state.sleep_state == 0
    world.neighbour_list.build(state, np.flatnonzero(live), STEP)
    found = listed(world)
    assert len(set(found)) == len(found)
    assert touching(state.position, state.radius, live) <= set(found)


def test_a_first_row_far_away_spoils_nothing() -> None:
    world = engine(gravity=0.0)
    rng = np.random.default_rng(1)
    at = rng.uniform(-0.3, 0.3, (301, 3)) + np.array([0.0, 0.0, 3.0])
    at[0, 0] = 1e6
    world.add(at, np.zeros_like(at), LITRE // 2, grow=False)
    live = np.ones(world.count, dtype=np.bool_)
    world.neighbour_list.build(world.state, np.arange(world.count), STEP)
    found = listed(world)
    assert len(found) > 300
    assert touching(world.state.position, world.state.radius, live) <= set(found)


@pytest.mark.parametrize("seed", range(10))
def test_all_who_touch_are_listed_while_some_come_and_go(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = engine()
    for _ in range(200):
        count = int(rng.integers(1, 9))
        if rng.uniform() < 0.3:
            at = rng.uniform([-0.3, -0.3, 0.1], [0.3, 0.3, 0.7], (count, 3))
            world.add(at, rng.normal(size=(count, 3)), LITRE // 4)
        if rng.uniform() < 0.3 and world.count > 30:
            ids = world.state.particle_id
            world.remove(rng.choice(ids, count, replace=False))
        if rng.uniform() < 0.05 and world.count:
            world.freeze(world.state.particle_id[-1:])
        state = world.state
        live = (state.sleep_state == 0) & ~state.frozen
        if not live.any():
            continue
        ids, before = state.particle_id.copy(), state.position.copy()
        world.step(STEP)
        found = listed(world)
        assert len(set(found)) == len(found)
        # As large as they have grown in the step, where they were at its beginning.
        near = touching(before, state.contact_radius[world.rows_of(ids)], live)
        by_id = {frozenset((int(ids[i]), int(ids[j]))) for i, j in near}
        now = state.particle_id.tolist()
        assert by_id <= {frozenset((now[i], now[j])) for i, j in found}
    assert world.num_list_builds < 150, "most came and went without a new list"


def test_history_stays_with_its_pair_when_others_go() -> None:
    world = engine()
    at = cloud(80, 0.08, (0.2, 0.2), 0.1)
    world.add(at, np.zeros_like(at), LITRE // 4, grow=False)
    for _ in range(80):
        world.step(STEP)
    world.store_springs()
    before = springs(world)
    gone = set(world.state.particle_id[::7].tolist())
    world.remove(sorted(gone))
    assert not world.neighbour_list.is_stale
    after = springs(world)
    left = {pair: spring for pair, spring in before.items() if not gone & set(pair)}
    assert 5 < len(left) < len(before)
    assert after == left


def springs(world: ParticleEngine) -> dict[tuple[int, int], tuple[float, ...]]:
    """Springs of the pairs that touch, by the ids of their particles."""
    pairs, ids = world.neighbour_list.pairs, world.state.particle_id
    return {
        (int(ids[pairs.first[k]]), int(ids[pairs.second[k]])): tuple(pairs.spring[k].tolist())
        for k in range(pairs.count)
        if pairs.contact_flag[k]
    }


def test_a_few_fast_ones_do_not_wear_the_list_out() -> None:
    """A column falls as one; crumbs beside it are at rest, seen from the map, or far faster."""
    builds = []
    for fast in (0, 5):
        world = engine(gravity=0.0)
        rng = np.random.default_rng(3)
        at = rng.uniform([-0.5, -0.5, 4.5], [0.5, 0.5, 5.5], (400, 3))
        speed = np.zeros_like(at)
        at[:fast, 0] += 3.0 + np.arange(fast)
        speed[:fast, 0] = 6.0
        world.add(at, speed, LITRE // 10, grow=False)
        for _ in range(40):
            world.step(STEP)
        builds.append(world.num_list_builds)
    assert builds[1] <= builds[0] + 40 // 4
