"""Whether a heap at rest is at rest: its kinetic energy, and how far it creeps, nobody asleep."""

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
    """What a heap does when nothing happens.

    Attributes:
        energy: kinetic energy over number, weight and diameter of the particles.
        creep: farthest that one went, in diameters.
        particles: how many.
    """

    energy: float
    creep: float
    particles: int


def resting_heap(
    soil: LooseSoil, count: int, *, settle: float = 20.0, watch: float = 60.0, **params: float
) -> HeapStability:
    """Drop a block of soil, wait for `settle` [s], and watch it for `watch` [s]."""
    engine = make_engine(soil, **params)
    d = particle_diameter(engine)
    half = 0.5 * d * count ** (1 / 3)
    points = layered_points(lambda at: np.abs(at).max(axis=1) < half, half, 1.3 * d, count, 0.5 * d)
    engine.add(points, np.zeros_like(points), VOLUME, grow=False)
    for _ in range(round(settle / STEP)):
        engine.step(STEP)
    before = engine.positions[np.argsort(engine.ids)].copy()
    for _ in range(round(watch / STEP)):
        engine.step(STEP)
    after = engine.positions[np.argsort(engine.ids)]
    weight = float(engine.masses.sum()) * engine.params.gravity
    creep = float(np.linalg.norm(after - before, axis=1).max()) / d
    return HeapStability(engine.kinetic_energy / (weight * d), creep, count)
