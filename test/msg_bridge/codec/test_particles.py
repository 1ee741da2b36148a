"""Particles are transmitted with their number and exact volume."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from support.wire import over_the_wire, raises

from machine_sim.dem.state import ParticleState
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.particles import PARTICLE, from_particle_cloud, to_particle_cloud
from msg_bridge.contract.errors import ErrorCode

STAMP = Time(sec=3, nanosec=40_000_000)


def some_particles(count):
    state = ParticleState(1000)
    rng = np.random.default_rng(3)
    state.add(
        count,
        position=rng.uniform(-50.0, 50.0, (count, 3)),
        velocity=rng.normal(size=(count, 3)),
        radius=rng.uniform(0.01, 0.2, count),
        volume_mm3=rng.integers(0, 2**32, count),
        soil=rng.integers(0, 256, count),
    )
    return state


def cloud_of(state, **change):
    names = ("position", "velocity", "radius", "particle_id", "volume_mm3", "soil")
    columns = {name: getattr(state, name) for name in names}
    return to_particle_cloud(**{**columns, **change}, frame_id="map", stamp=STAMP)


@pytest.mark.parametrize("count", [0, 1, 500])
def test_particles_are_transmitted(count):
    state = some_particles(count)
    msg = over_the_wire(cloud_of(state))
    rows = from_particle_cloud(msg)
    assert rows.size == count
    assert (msg.header.frame_id, msg.header.stamp) == ("map", STAMP)
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(rows[name], state.position[:, axis].astype("f4"))
        np.testing.assert_array_equal(rows[f"v{name}"], state.velocity[:, axis].astype("f4"))
    np.testing.assert_array_equal(rows["diameter"], 2.0 * state.radius)
    np.testing.assert_array_equal(rows["id"], state.particle_id)
    np.testing.assert_array_equal(rows["volume_mm3"], state.volume_mm3)
    np.testing.assert_array_equal(rows["soil"], state.soil)


def test_point_is_packed():
    assert PARTICLE.itemsize == 37
    names = "x y z vx vy vz diameter id volume_mm3 soil"
    assert [field.name for field in cloud_of(some_particles(1)).fields] == names.split()


@pytest.mark.parametrize("volume", [-1, 2**32])
def test_volume_out_of_range_is_rejected(volume):
    state = some_particles(3)
    with raises(ErrorCode.VALUE, CodecError):
        cloud_of(state, volume_mm3=np.array([1, volume, 1]))


@pytest.mark.parametrize("name", ["position", "velocity", "radius", "volume_mm3", "soil"])
def test_arrays_of_different_lengths_are_rejected(name):
    state = some_particles(3)
    with raises(ErrorCode.SHAPE, CodecError):
        cloud_of(state, **{name: getattr(state, name)[:1]})


def test_cloud_with_other_fields_is_rejected():
    msg = cloud_of(some_particles(1))
    msg.fields[3].name = "speed"
    with raises(ErrorCode.FIELDS, CodecError):
        from_particle_cloud(msg)
