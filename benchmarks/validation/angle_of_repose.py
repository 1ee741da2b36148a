"""Measure the angle of repose of a heap poured slowly on one spot of level ground."""

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
"""Radius of the spot, in particle diameters."""
_POUR_SPEED = 0.3
"""Speed at which particles leave the funnel, which rises with the heap [m/s]."""
_HEAP_SPEED_LIMIT = 0.3
"""Speed below which a particle belongs to the heap [m/s]."""


def poured_repose_angle(
    soil: LooseSoil, count: int, *, rate: float = 200.0, moisture: int = 0, **params: float
) -> float:
    """Return the angle of a poured heap [deg].

    Args:
        soil: the soil.
        count: number of particles.
        rate: particles poured per second.
        moisture: moisture of the soil [% of saturation].
        params: further parameters of `ParticleParams`.
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
            point = np.array([x, y, top + 1.5 * d])
            if not engine.count or ((engine.positions - point) ** 2).sum(axis=1).min() > d**2:
                engine.add(point, [0.0, 0.0, -_POUR_SPEED], VOLUME, moisture=moisture, grow=False)
        if engine.count:
            engine.step(STEP)
    settle(engine)
    return math.degrees(math.atan(_slope(engine.positions, engine.radii)))


def _slope(position: NDArray[np.float64], radius: NDArray[np.float32]) -> float:
    """Return the slope of a heap: a line fitted to mean surface heights from 0.2 to 0.85 radii.

    The surface height of a ring is the mean of the highest particle tops of its sectors; the heap
    radius is the 98th percentile of the particles' distances from the axis.
    """
    offset = position[:, :2] - np.median(position[:, :2], axis=0)
    distance = np.hypot(offset[:, 0], offset[:, 1])
    azimuth = np.arctan2(offset[:, 1], offset[:, 0]) + math.pi
    heap_radius = float(np.quantile(distance, 0.98))
    width = 2.0 * float(radius.mean())
    mean_radii, mean_heights = [], []
    for inner in np.arange(0.2 * heap_radius, 0.85 * heap_radius - width, width):
        in_ring = (distance >= inner) & (distance < inner + width)
        num_sectors = max(6, int(math.pi * (2.0 * inner + width) / (3.0 * width)))
        sector = (azimuth[in_ring] / (2.0 * math.pi) * num_sectors).astype(int) % num_sectors
        heights = np.zeros(num_sectors)
        np.maximum.at(heights, sector, (position[:, 2] + radius)[in_ring])
        mean_radii.append(inner + 0.5 * width)
        mean_heights.append(heights.mean())
    return -float(np.polyfit(mean_radii, mean_heights, 1)[0])
