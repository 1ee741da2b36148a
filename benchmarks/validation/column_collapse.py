"""Collapse of a column of soil, against the laws Lube found.

Lube, Huppert, Sparks, Hallworth: Axisymmetric collapses of granular columns, J. Fluid Mech. 508
(2004) 175-199, doi:10.1017/S0022112004009036; Collapses of two-dimensional granular columns, Phys.
Rev. E 72 (2005) 041301. The runout depends on the aspect ratio alone, not on the grains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.validation.experiment_setup import (
    STEP,
    VOLUME,
    bulk_volume,
    layered_points,
    make_engine,
    particle_diameter,
    settle,
    tube_plates,
    wall_plate,
)
from machine_sim.dem import ParticleEngine, Pose
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["Collapse", "axisymmetric", "planar"]

_INITIAL_SPACING = 1.3
"""Distance of particles as they are put in, in diameters: they fall together, in no order."""
_RUNOUT_MASS_FRACTION = 0.98
"""Part of the mass within the runout."""
_CHANNEL_WIDTH = 1.5
"""Width of the planar column's channel, in lengths of the column."""
_IDENTITY_POSE: Pose = (np.eye(3), np.zeros(3))
_WALLS, _GATE = 0, 1


@dataclass(frozen=True)
class Collapse:
    """What became of a column.

    Attributes:
        aspect: its height over its radius or length, as it stood before.
        runout: how far the soil came beyond the column, in radii or lengths.
        law: what Lube found for that aspect ratio.
        particles: how many.
        time: until it came to rest [s].
    """

    aspect: float
    runout: float
    law: float
    particles: int
    time: float

    @property
    def ratio(self) -> float:
        """Runout over the law's."""
        return self.runout / self.law


def axisymmetric(soil: LooseSoil, aspect: float, count: int, **params: float) -> Collapse:
    """Let a round column go: a tube is filled and taken away.

    Args:
        soil: its soil.
        aspect: height over radius, about.
        count: number of particles.
        params: of `ParticleParams`.
    """
    engine = make_engine(soil, **params)
    d = particle_diameter(engine)
    radius = (bulk_volume(engine, count) / (math.pi * aspect)) ** (1 / 3)
    points = layered_points(
        lambda at: np.hypot(at[:, 0], at[:, 1]) < radius - 0.6 * d,
        radius,
        _INITIAL_SPACING * d,
        count,
        0.5 * d,
    )
    engine.add_tool(
        _WALLS, tube_plates(radius, float(points[:, 2].max()) + d), _IDENTITY_POSE, is_digging=False
    )
    height = _fill(engine, points)
    engine.remove_tool(_WALLS)
    time = settle(engine)
    away = np.hypot(engine.positions[:, 0], engine.positions[:, 1])
    a = height / radius
    law = 1.24 * a if a < 1.7 else 1.6 * math.sqrt(a)
    return Collapse(
        a, float(np.quantile(away, _RUNOUT_MASS_FRACTION)) / radius - 1.0, law, count, time
    )


def planar(soil: LooseSoil, aspect: float, count: int, **params: float) -> Collapse:
    """Let a column between a wall and a gate go, in a channel: the gate is taken away.

    Args:
        soil: its soil.
        aspect: height over length, about.
        count: number of particles.
        params: of `ParticleParams`.
    """
    engine = make_engine(soil, size=80.0, **params)
    d = particle_diameter(engine)
    length = (bulk_volume(engine, count) / (_CHANNEL_WIDTH * aspect)) ** (1 / 3)
    half, far = 0.5 * _CHANNEL_WIDTH * length, 8.0 * length
    points = layered_points(
        lambda at: (
            (at[:, 0] > 0.6 * d)
            & (at[:, 0] < length - 0.6 * d)
            & (np.abs(at[:, 1]) < half - 0.6 * d)
        ),
        length,
        _INITIAL_SPACING * d,
        count,
        0.5 * d,
    )
    top = float(points[:, 2].max()) + d
    channel = [
        wall_plate(0.0, -half, 0.0, half, top),
        wall_plate(0.0, -half, far, -half, top),
        wall_plate(0.0, half, far, half, top),
    ]
    engine.add_tool(_WALLS, channel, _IDENTITY_POSE, is_digging=False)
    engine.add_tool(
        _GATE, [wall_plate(length, -half, length, half, top)], _IDENTITY_POSE, is_digging=False
    )
    height = _fill(engine, points)
    engine.remove_tool(_GATE)
    time = settle(engine)
    a = height / length
    law = 1.2 * a if a < 2.3 else 1.9 * a ** (2 / 3)
    reached = float(np.quantile(engine.positions[:, 0], _RUNOUT_MASS_FRACTION))
    return Collapse(a, reached / length - 1.0, law, count, time)


def _fill(engine: ParticleEngine, points: np.ndarray) -> float:
    """Put the soil in and let it settle; returns the height it stands [m]."""
    engine.add(points, np.zeros_like(points), VOLUME, grow=False)
    for _ in range(round(2.5 / STEP)):
        engine.step(STEP)
    # A column of even density is twice as high as its centre.
    return 2.0 * float(engine.positions[:, 2].mean())
