"""Measure the kinetic energy and the creep of a heap at rest, with all particles awake."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.validation.experiment_setup import (
    STEP,
    VOLUME,
    layered_points,
    make_engine,
    particle_diameter,
)
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["HeapStability", "resting_heap"]


@dataclass(frozen=True)
class HeapStability:
    """Residual motion of a heap at rest.

    Attributes:
        energy: kinetic energy over total weight times particle diameter.
        creep: maximum displacement of a particle, in diameters.
        num_particles: number of particles.
    """

    energy: float
    creep: float
    num_particles: int


def resting_heap(
    soil: LooseSoil,
    count: int,
    *,
    settle_time: float = 20.0,
    duration: float = 60.0,
    **params: float,
) -> HeapStability:
    """Drop a block of soil, let it settle, and measure its motion.

    Args:
        soil: the soil.
        count: number of particles.
        settle_time: time before the measurement [s].
        duration: duration of the measurement [s].
        params: further parameters of `ParticleParams`.
    """
    engine = make_engine(soil, **params)
    d = particle_diameter(engine)
    half = 0.5 * d * count ** (1 / 3)
    points = layered_points(lambda xy: np.abs(xy).max(axis=1) < half, half, 1.3 * d, count, 0.5 * d)
    engine.add(points, np.zeros_like(points), VOLUME, grow=False)
    for _ in range(round(settle_time / STEP)):
        engine.step(STEP)
    before = engine.positions[np.argsort(engine.ids)].copy()
    for _ in range(round(duration / STEP)):
        engine.step(STEP)
    after = engine.positions[np.argsort(engine.ids)]
    weight = float(engine.masses.sum()) * engine.params.gravity
    creep = float(np.linalg.norm(after - before, axis=1).max()) / d
    return HeapStability(engine.kinetic_energy / (weight * d), creep, count)
