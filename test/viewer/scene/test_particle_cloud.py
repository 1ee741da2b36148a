"""Particles keep their position and speed within the resolution of the stream."""

from __future__ import annotations

import numpy as np

from msg_bridge.codec.particles import PARTICLE
from viewer.scene.particle_cloud import DISPLAY_PARTICLE, encode_particles


def cloud(count: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    rows = np.zeros(count, dtype=PARTICLE)
    for name in ("x", "y", "z"):
        rows[name] = rng.uniform(-25.0, 25.0, count)
        rows[f"v{name}"] = rng.uniform(-5.0, 5.0, count)
    rows["diameter"], rows["soil"] = 0.3, 2
    rows["id"] = np.arange(count)
    return rows


def test_particles_of_several_nodes_are_one_block() -> None:
    first, second = cloud(500), cloud(300, seed=1)
    block = encode_particles([first, second])
    found = np.frombuffer(block.data, DISPLAY_PARTICLE)
    assert block.count == found.size == 800
    assert found.dtype.itemsize == 16
    positions = np.array(block.origin) + np.array(block.scale) * found["position"]
    expected = np.concatenate([first, second])
    np.testing.assert_allclose(positions[:, 0], expected["x"], atol=0.5e-3)
    np.testing.assert_allclose(found["velocity"][:, 2] / 1e3, expected["vz"], atol=0.6e-3)
    assert (found["diameter"] == 60).all()
    assert np.unique(found["id"]).size == 800


def test_particles_that_are_not_finite_or_too_fast_do_no_harm() -> None:
    rows = cloud(10)
    rows["x"][3], rows["vy"][4], rows["vx"][5] = np.nan, np.inf, 1e6
    block = encode_particles([rows])
    found = np.frombuffer(block.data, DISPLAY_PARTICLE)
    assert block.count == 8
    assert found["velocity"].max() == 32767
    assert encode_particles([]).count == 0
