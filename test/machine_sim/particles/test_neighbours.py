"""The neighbour list against brute force: nobody is missed, nobody listed twice."""

from __future__ import annotations

import numpy as np
import pytest
from support.particle_scenes import LITRE, STEP, engine

from machine_sim.particles import ParticleEngine


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
    pairs = world._pairs.pairs
    both = np.stack([pairs.first[: pairs.count], pairs.second[: pairs.count]], axis=1)
    return [tuple(pair) for pair in np.sort(both.astype(np.int64), axis=1).tolist()]


def touching(world: ParticleEngine, live: np.ndarray) -> set[tuple[int, int]]:
    store = world.store
    radius = store.radius.astype(float)
    distance = np.linalg.norm(store.position[:, None] - store.position[None], axis=2)
    near = distance < 1.03 * (radius[:, None] + radius[None])
    near &= live[:, None] | live[None]
    return {(int(i), int(j)) for i, j in zip(*np.nonzero(near), strict=True) if i < j}


@pytest.mark.parametrize("seed", range(40))
def test_all_who_touch_are_listed_once(seed: int) -> None:
    world = scene(seed)
    store = world.store
    asleep = np.random.default_rng(seed + 1000).uniform(size=world.count) < (seed % 4) / 3.2
    asleep[0] = False
    store.resting[asleep] = 1
    store.velocity[asleep] = 0.0
    live = store.resting == 0
    world._pairs.build(store, np.flatnonzero(live), live, STEP)
    found = listed(world)
    assert len(set(found)) == len(found)
    assert touching(world, live) <= set(found)


def test_a_first_row_far_away_spoils_nothing() -> None:
    world = engine(gravity=0.0)
    rng = np.random.default_rng(1)
    at = rng.uniform(-0.3, 0.3, (301, 3)) + np.array([0.0, 0.0, 3.0])
    at[0, 0] = 1e6
    world.add(at, np.zeros_like(at), LITRE // 2, grow=False)
    live = np.ones(world.count, dtype=np.bool_)
    world._pairs.build(world.store, np.arange(world.count), live, STEP)
    found = listed(world)
    assert len(found) > 300
    assert touching(world, live) <= set(found)
