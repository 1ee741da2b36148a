"""Verlet list compared with brute force: all pairs in contact are listed, each once."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, cloud, engine

from machine_sim.dem import ParticleEngine


def scene(seed: int) -> ParticleEngine:
    """Return an engine with particles of many sizes and speeds, some of them far away."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 300))
    world = engine(gravity=0.0)
    at = rng.normal(size=(count, 3)) * rng.uniform(0.1, 1.5) + [0.0, 0.0, 5.0]
    at[: rng.integers(0, 3)] *= 10.0 ** rng.uniform(0, 4)
    volume = (LITRE * 10.0 ** rng.uniform(-3, 0.6, count)).astype(np.int64)
    speed = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-3, 1)
    world.add(at, speed, volume, grow=False)
    return world


def listed_pairs(world: ParticleEngine) -> list[tuple[int, int]]:
    """Return the listed pairs of rows, the lower row first."""
    pairs = world.neighbour_list.pairs
    both = np.stack([pairs.first[: pairs.count], pairs.second[: pairs.count]], axis=1)
    return [tuple(pair) for pair in np.sort(both.astype(np.int64), axis=1).tolist()]


def touching_pairs(
    position: NDArray[np.float64], radius: NDArray[np.float32], active: NDArray[np.bool_]
) -> set[tuple[int, int]]:
    """Return the pairs within 1.03 sums of radii, of which one particle at least is active."""
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    sums = radius.astype(float)[:, None] + radius[None]
    near = distance < 1.03 * sums
    near &= active[:, None] | active[None]
    return {(int(i), int(j)) for i, j in zip(*np.nonzero(near), strict=True) if i < j}


@pytest.mark.parametrize("seed", range(40))
def test_all_pairs_in_contact_are_listed_once(seed: int) -> None:
    world = scene(seed)
    state = world.state
    asleep = np.random.default_rng(seed + 1000).uniform(size=world.count) < (seed % 4) / 3.2
    asleep[0] = False
    state.sleep_state[asleep] = 1
    state.velocity[asleep] = 0.0
    active = state.sleep_state == 0
    world.neighbour_list.build(state, np.flatnonzero(active), STEP)
    listed = listed_pairs(world)
    assert len(set(listed)) == len(listed)
    assert touching_pairs(state.position, state.radius, active) <= set(listed)


def test_list_is_complete_if_the_first_row_is_far_away() -> None:
    world = engine(gravity=0.0)
    rng = np.random.default_rng(1)
    at = rng.uniform(-0.3, 0.3, (301, 3)) + np.array([0.0, 0.0, 3.0])
    at[0, 0] = 1e6
    world.add(at, np.zeros_like(at), LITRE // 2, grow=False)
    active = np.ones(world.count, dtype=np.bool_)
    world.neighbour_list.build(world.state, np.arange(world.count), STEP)
    listed = listed_pairs(world)
    assert len(listed) > 300
    assert touching_pairs(world.state.position, world.state.radius, active) <= set(listed)


@pytest.mark.parametrize("seed", range(10))
def test_list_stays_complete_through_insertion_and_removal(seed: int) -> None:
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
        active = (state.sleep_state == 0) & ~state.frozen
        if not active.any():
            continue
        ids, before = state.particle_id.copy(), state.position.copy()
        world.step(STEP)
        listed = listed_pairs(world)
        assert len(set(listed)) == len(listed)
        # Positions at the start of the step, contact radii after growth in it.
        near = touching_pairs(before, state.contact_radius[world.rows_of(ids)], active)
        by_id = {frozenset((int(ids[i]), int(ids[j]))) for i, j in near}
        ids_after = state.particle_id.tolist()
        assert by_id <= {frozenset((ids_after[i], ids_after[j])) for i, j in listed}
    assert world.neighbour_list.num_builds < 150, "particles were inserted by rebuilding the list"


def test_springs_stay_with_their_pairs_when_others_are_removed() -> None:
    world = engine()
    at = cloud(80, 0.08, (0.2, 0.2), 0.1)
    world.add(at, np.zeros_like(at), LITRE // 4, grow=False)
    for _ in range(80):
        world.step(STEP)
    world.store_springs()
    before = springs(world)
    removed = set(world.state.particle_id[::7].tolist())
    world.remove(sorted(removed))
    assert not world.neighbour_list.is_stale
    after = springs(world)
    expected = {pair: spring for pair, spring in before.items() if not removed & set(pair)}
    assert 5 < len(expected) < len(before)
    assert after == expected


def springs(world: ParticleEngine) -> dict[tuple[int, int], tuple[float, ...]]:
    """Return the springs of the pairs in contact, by the ids of their particles."""
    pairs, ids = world.neighbour_list.pairs, world.state.particle_id
    return {
        (int(ids[pairs.first[k]]), int(ids[pairs.second[k]])): tuple(pairs.spring[k].tolist())
        for k in range(pairs.count)
        if pairs.contact_flag[k]
    }


def test_few_fast_particles_trigger_few_rebuilds_of_the_list() -> None:
    """Compare a cloud at rest with one that a few fast particles leave."""
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
        builds.append(world.neighbour_list.num_builds)
    assert builds[1] <= builds[0] + 40 // 4
