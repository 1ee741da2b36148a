"""Angle of repose: soil poured slowly on one spot of a level bench."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.validation.experiment_setup import (
    STEP,
    VOLUME,
    make_engine,
    particle_diameter,
    settle,
)
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["poured_repose_angle"]

_SPOT_RADIUS = 2.0
"""Radius of the spot, in diameters."""
_POUR_SPEED = 0.3
"""At which soil leaves the funnel, which goes up with the heap [m/s]."""
_HEAP_SPEED_LIMIT = 0.3
"""What is slower belongs to the heap [m/s]."""


def poured_repose_angle(
    soil: LooseSoil, count: int, *, rate: float = 200.0, moisture: int = 0, **params: float
) -> float:
    """Angle of a heap [deg].

    Args:
        soil: its soil.
        count: number of particles.
        rate: of pouring, particles per second.
        moisture: of the soil [% of saturation].
        params: of `ParticleParams`.
    """
    engine = make_engine(soil, **params)
    d = particle_diameter(engine)
    rng = np.random.default_rng(0)
    due = 0.0
    while engine.count < count:
        due += rate * STEP
        if due >= 1.0:
            due -= 1.0
            x, y = _SPOT_RADIUS * d * rng.uniform(-1.0, 1.0, 2) / math.sqrt(2.0)
            near = np.hypot(engine.positions[:, 0], engine.positions[:, 1]) < _SPOT_RADIUS * d
            heap = near & ((engine.velocities**2).sum(axis=1) < _HEAP_SPEED_LIMIT**2)
            top = float(engine.positions[heap, 2].max()) if heap.any() else 0.0
            at = np.array([x, y, top + 1.5 * d])
            if not engine.count or ((engine.positions - at) ** 2).sum(axis=1).min() > d**2:
                engine.add(at, [0.0, 0.0, -_POUR_SPEED], VOLUME, moisture=moisture, grow=False)
        if engine.count:
            engine.step(STEP)
    settle(engine)
    return math.degrees(math.atan(_slope(engine.positions, engine.radii)))


def _slope(position: NDArray[np.float64], radius: NDArray[np.float32]) -> float:
    """Of a heap: a line through the tops of its sectors, from a fifth to 0.85 of its foot."""
    at = position[:, :2] - np.median(position[:, :2], axis=0)
    away, turn = np.hypot(at[:, 0], at[:, 1]), np.arctan2(at[:, 1], at[:, 0]) + math.pi
    foot = float(np.quantile(away, 0.98))
    width = 2.0 * float(radius.mean())
    middle, top = [], []
    for low in np.arange(0.2 * foot, 0.85 * foot - width, width):
        ring = (away >= low) & (away < low + width)
        sectors = max(6, int(math.pi * (2.0 * low + width) / (3.0 * width)))
        sector = (turn[ring] / (2.0 * math.pi) * sectors).astype(int) % sectors
        height = np.zeros(sectors)
        np.maximum.at(height, sector, (position[:, 2] + radius)[ring])
        middle.append(low + 0.5 * width)
        top.append(height.mean())
    return -float(np.polyfit(middle, top, 1)[0])
