"""The volume account and the identity of particles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.particle_scenes import LITRE, STEP, engine

from machine_sim.dem import ParticleError
from msg_bridge.contract.loose_soil import LooseSoil

THREE = np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0.2, 1.0]])
actions = st.lists(
    st.tuples(
        st.sampled_from(["add", "remove", "freeze", "unfreeze", "step"]),
        st.integers(0, 2**31),
    ),
    max_size=25,
)


@settings(max_examples=40, deadline=None)
@given(actions)
def test_volume_is_exact_under_any_work(work):
    world = engine(soils=[LooseSoil()] * 3)
    book = {}
    last = 0
    for action, seed in work:
        rng = np.random.default_rng(seed)
        some = rng.permutation(list(book))[: rng.integers(0, 6)].astype(np.uint32)
        if action == "add":
            n = int(rng.integers(0, 30))
            volumes = rng.integers(1, 3 * LITRE, n)
            at = rng.uniform([-0.3, -0.3, 0.3], [0.3, 0.3, 0.9], (n, 3))
            ids = world.add(at, np.zeros((n, 3)), volumes, 2, 9)
            assert n == 0 or ids[0] > last
            last = max(last, int(ids[-1]) if n else 0)
            book.update(zip(ids.tolist(), volumes.tolist(), strict=True))
        elif action == "step":
            world.step(STEP)
        else:
            getattr(world, action)(some)
            if action == "remove":
                for gone in some.tolist():
                    del book[gone]
        assert world.total_volume_mm3 == sum(book.values())
        held = dict(
            zip(world.state.particle_id.tolist(), world.state.volume_mm3.tolist(), strict=True)
        )
        assert held == book
        assert np.isfinite(world.state.position).all()


@pytest.mark.parametrize("method", ["remove", "freeze", "unfreeze"])
@pytest.mark.parametrize("ids", [[1, 99], [1, 1], [0], [2**33]])
def test_ids_that_are_not_alive_are_refused_and_change_nothing(method, ids):
    world = engine()
    world.add(THREE, np.zeros((3, 3)), LITRE)
    with pytest.raises(ParticleError):
        getattr(world, method)(ids)
    assert world.count == 3
    assert not world.state.frozen.any()


def test_an_id_is_never_used_twice():
    world = engine()
    first = world.add([[0, 0, 1]], [[0, 0, 0]], LITRE)
    world.remove(first)
    second = world.add([[0, 0, 1]], [[0, 0, 0]], LITRE)
    assert (first[0], second[0]) == (1, 2)
    with pytest.raises(ParticleError):
        world.remove(first)


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
def test_bad_particles_are_refused(position, volume):
    world = engine()
    with pytest.raises(ParticleError):
        world.add(position, [[0, 0, 0]], volume)
    assert world.count == 0


@pytest.mark.parametrize("velocity", [[0, 0, -1e19], [1e300, 0, 0], [800, 800, 0]])
def test_speeds_that_no_soil_has_are_refused(velocity):
    world = engine()
    with pytest.raises(ParticleError, match="1000 m/s"):
        world.add([[0, 0, 1]], [velocity], LITRE)
    assert world.count == 0


def test_the_fastest_and_farthest_particles_do_no_harm():
    world = engine()
    world.add([[0, 0, 1], [0, 0, 2], [1e6, -1e6, 1e6]], [[600, 0, -800]] * 3, LITRE, grow=False)
    world.add([[0.02, 0, 0.3]], np.zeros((1, 3)), LITRE, grow=False)
    for _ in range(100):
        world.step(STEP)
    for column in (world.state.position, world.state.velocity, world.state.angular_velocity):
        assert np.isfinite(column).all()
    assert world.total_volume_mm3 == 4 * LITRE


def test_more_than_the_capacity_is_refused_whole():
    world = engine(capacity=5)
    world.add(THREE, np.zeros((3, 3)), LITRE)
    assert world.free_capacity == 2
    with pytest.raises(ParticleError, match="capacity"):
        world.add(THREE, np.zeros((3, 3)), LITRE)
    assert world.count == 3
