"""Both engines: exact volume and permanent ids of particles, and validation of added ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.particle_scenes import LITRE, STEP, cubes, engine

from machine_sim.dem import ParticleError
from msg_bridge.contract.loose_soil import LooseSoil

THREE = np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0.2, 1.0]])
both_engines = pytest.mark.parametrize("make", [engine, cubes])
actions = st.lists(
    st.tuples(
        st.sampled_from(["add", "remove", "freeze", "unfreeze", "step"]),
        st.integers(0, 2**31),
    ),
    max_size=25,
)


@both_engines
@settings(max_examples=25, deadline=None)
@given(calls=actions)
def test_volume_is_exact_after_any_sequence_of_calls(make, calls):
    world = make(soils=[LooseSoil()] * 3)
    volume_by_id = {}
    last_id = 0
    for action, seed in calls:
        rng = np.random.default_rng(seed)
        chosen = rng.permutation(list(volume_by_id))[: rng.integers(0, 6)].astype(np.uint32)
        if action == "add":
            n = int(rng.integers(0, 30))
            volumes = rng.integers(1, 3 * LITRE, n)
            points = rng.uniform([-0.3, -0.3, 0.3], [0.3, 0.3, 0.9], (n, 3))
            ids = world.add(points, np.zeros((n, 3)), volumes, 2, 9)
            assert n == 0 or ids[0] > last_id
            last_id = max(last_id, int(ids[-1]) if n else 0)
            volume_by_id.update(zip(ids.tolist(), volumes.tolist(), strict=True))
        elif action == "step":
            world.step(STEP)
        else:
            getattr(world, action)(chosen)
            if action == "remove":
                for removed in chosen.tolist():
                    del volume_by_id[removed]
        assert world.total_volume_mm3 == sum(volume_by_id.values())
        found = dict(zip(world.ids.tolist(), world.volumes_mm3.tolist(), strict=True))
        assert found == volume_by_id
        assert np.isfinite(world.positions).all()


@both_engines
@pytest.mark.parametrize("method", ["remove", "freeze", "unfreeze"])
@pytest.mark.parametrize("ids", [[1, 99], [1, 1], [0], [2**33]])
def test_unknown_ids_are_rejected_and_change_nothing(make, method, ids):
    world = make()
    world.add(THREE, np.zeros((3, 3)), LITRE)
    with pytest.raises(ParticleError):
        getattr(world, method)(ids)
    assert world.count == 3
    assert world.frozen_ids.size == 0


@both_engines
def test_ids_are_never_reused(make):
    world = make()
    first = world.add([[0, 0, 1]], [[0, 0, 0]], LITRE)
    world.remove(first)
    second = world.add([[0, 0, 1]], [[0, 0, 0]], LITRE)
    assert (first[0], second[0]) == (1, 2)
    with pytest.raises(ParticleError):
        world.remove(first)


@both_engines
@pytest.mark.parametrize(
    ("position", "volume"),
    [
        ([[0, 0, np.nan]], LITRE),
        ([[np.inf, 0, 0]], LITRE),
        ([[0, 0, 1e19]], LITRE),
        ([[0, -1.1e6, 0]], LITRE),
        ([[0, 0, 1]], 0),
        ([[0, 0, 1]], -5),
        ([[0, 0, 1]], 0.5),
        ([[0, 0, 1]], 2**33),
        ([[0, 0, 1]], [LITRE, LITRE]),
        ([[0, 0]], LITRE),
    ],
)
def test_invalid_particles_are_rejected(make, position, volume):
    world = make()
    with pytest.raises(ParticleError):
        world.add(position, [[0, 0, 0]], volume)
    assert world.count == 0
    world.step(STEP)


@both_engines
@pytest.mark.parametrize("soil", [1, 256])
def test_unknown_soils_are_rejected(make, soil):
    world = make()
    with pytest.raises(ParticleError):
        world.add([[0, 0, 1]], [[0, 0, 0]], LITRE, soil)
    assert world.count == 0


@pytest.mark.parametrize("velocity", [[0, 0, -1e19], [1e300, 0, 0], [800, 800, 0]])
def test_excessive_speeds_are_rejected(velocity):
    world = engine()
    with pytest.raises(ParticleError):
        world.add([[0, 0, 1]], [velocity], LITRE)
    assert world.count == 0


def test_fastest_and_farthest_particles_stay_finite():
    world = engine()
    world.add([[0, 0, 1], [0, 0, 2], [1e6, -1e6, 1e6]], [[600, 0, -800]] * 3, LITRE, grow=False)
    world.add([[0.02, 0, 0.3]], np.zeros((1, 3)), LITRE, grow=False)
    for _ in range(100):
        world.step(STEP)
    for column in (world.positions, world.velocities, world.angular_velocities):
        assert np.isfinite(column).all()
    assert world.total_volume_mm3 == 4 * LITRE


@both_engines
def test_particles_beyond_the_capacity_are_all_rejected(make):
    world = make(capacity=5)
    world.add(THREE, np.zeros((3, 3)), LITRE)
    assert world.free_capacity == 2
    with pytest.raises(ParticleError, match="capacity"):
        world.add(THREE, np.zeros((3, 3)), LITRE)
    assert world.count == 3
