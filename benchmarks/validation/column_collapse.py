"""Measure the runout of a collapsing column of soil, and compare it with the laws of Lube et al.

Lube, Huppert, Sparks, Hallworth: Axisymmetric collapses of granular columns, J. Fluid Mech. 508
(2004) 175-199, doi:10.1017/S0022112004009036; Collapses of two-dimensional granular columns, Phys.
Rev. E 72 (2005) 041301. The runout depends on the aspect ratio only, not on the grains.
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

__all__ = [
    "CollapseResult",
    "axisymmetric_law",
    "collapse_axisymmetric",
    "collapse_planar",
    "planar_law",
]

_INITIAL_SPACING = 1.3
"""Initial spacing of particles, in diameters, so that they fall into a random packing."""
_RUNOUT_MASS_FRACTION = 0.98
"""Fraction of the mass within the runout."""
_CHANNEL_WIDTH = 1.5
"""Width of the planar column's channel, in lengths of the column."""
_IDENTITY_POSE: Pose = (np.eye(3), np.zeros(3))
_WALLS, _GATE = 0, 1
"""Tool numbers."""


@dataclass(frozen=True)
class CollapseResult:
    """Runout of a column.

    Attributes:
        aspect: initial height over radius or length.
        runout: distance that the soil moved beyond the column, in radii or lengths.
        expected_runout: runout by the law for that aspect ratio.
        num_particles: number of particles.
        time: time until rest [s].
    """

    aspect: float
    runout: float
    expected_runout: float
    num_particles: int
    time: float

    @property
    def ratio(self) -> float:
        """Runout over expected runout."""
        return self.runout / self.expected_runout


def axisymmetric_law(aspect: float) -> float:
    """Return the runout of a round column in radii (Lube et al. 2004)."""
    return 1.24 * aspect if aspect < 1.7 else 1.6 * math.sqrt(aspect)


def planar_law(aspect: float) -> float:
    """Return the runout of a planar column in lengths (Lube et al. 2005)."""
    return 1.2 * aspect if aspect < 2.3 else 1.9 * aspect ** (2 / 3)


def collapse_axisymmetric(
    soil: LooseSoil, aspect: float, count: int, **params: float
) -> CollapseResult:
    """Fill a tube, remove it, and measure the runout of the round column.

    Args:
        soil: the soil.
        aspect: approximate height over radius.
        count: number of particles.
        params: further parameters of `ParticleParams`.
    """
    engine = make_engine(soil, **params)
    d = particle_diameter(engine)
    radius = (bulk_volume(engine, count) / (math.pi * aspect)) ** (1 / 3)
    points = layered_points(
        lambda xy: np.hypot(xy[:, 0], xy[:, 1]) < radius - 0.6 * d,
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
    distance = np.hypot(engine.positions[:, 0], engine.positions[:, 1])
    reached = float(np.quantile(distance, _RUNOUT_MASS_FRACTION))
    a = height / radius
    return CollapseResult(a, reached / radius - 1.0, axisymmetric_law(a), count, time)


def collapse_planar(soil: LooseSoil, aspect: float, count: int, **params: float) -> CollapseResult:
    """Fill a channel between a wall and a gate, remove the gate, and measure the runout.

    Args:
        soil: the soil.
        aspect: approximate height over length.
        count: number of particles.
        params: further parameters of `ParticleParams`.
    """
    engine = make_engine(soil, size=80.0, **params)
    d = particle_diameter(engine)
    length = (bulk_volume(engine, count) / (_CHANNEL_WIDTH * aspect)) ** (1 / 3)
    half, channel_length = 0.5 * _CHANNEL_WIDTH * length, 8.0 * length
    points = layered_points(
        lambda xy: (
            (xy[:, 0] > 0.6 * d)
            & (xy[:, 0] < length - 0.6 * d)
            & (np.abs(xy[:, 1]) < half - 0.6 * d)
        ),
        length,
        _INITIAL_SPACING * d,
        count,
        0.5 * d,
    )
    top = float(points[:, 2].max()) + d
    channel = [
        wall_plate(0.0, -half, 0.0, half, top),
        wall_plate(0.0, -half, channel_length, -half, top),
        wall_plate(0.0, half, channel_length, half, top),
    ]
    engine.add_tool(_WALLS, channel, _IDENTITY_POSE, is_digging=False)
    engine.add_tool(
        _GATE, [wall_plate(length, -half, length, half, top)], _IDENTITY_POSE, is_digging=False
    )
    height = _fill(engine, points)
    engine.remove_tool(_GATE)
    time = settle(engine)
    a = height / length
    reached = float(np.quantile(engine.positions[:, 0], _RUNOUT_MASS_FRACTION))
    return CollapseResult(a, reached / length - 1.0, planar_law(a), count, time)


def _fill(engine: ParticleEngine, points: np.ndarray) -> float:
    """Add the particles, let them settle, and return the height of the column [m]."""
    engine.add(points, np.zeros_like(points), VOLUME, grow=False)
    for _ in range(round(2.5 / STEP)):
        engine.step(STEP)
    # A column of uniform density is twice as high as its centre of mass.
    return 2.0 * float(engine.positions[:, 2].mean())
