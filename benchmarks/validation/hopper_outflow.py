"""Measure the outflow of a bin through a round hole in its floor; compare with Beverloo's law.

Beverloo, Leniger, van de Velde: The flow of granular solids through orifices, Chem. Eng. Sci. 15
(1961) 260-269, doi:10.1016/0009-2509(61)85030-6: W = C rho sqrt(g) (D - k d)^2.5, for a hole of
diameter D and grains of diameter d, with C = 0.58 and k = 1.4, rho the density of the soil as it
lies in the bin. It is measured before the hole is opened: 0.57 to 0.62 of the density of a
particle, the more the wider the bin. Neither depth nor width of the bin matter where both are well
above D.

k is that of sand, and the law is an approximation: measurements of beads over a wide range of holes
deviate from it in both directions (Mankoc et al., Granular Matter 9 (2007) 407,
doi:10.1007/s10035-007-0062-2). The exponent is therefore fitted over a range of holes as wide as
possible without jamming and with an acceptable run time.

C depends on friction where it is low, and on the rolling resistance that stands for the shape of
the grains: `docs/validation.md` has the measurements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.validation.experiment_setup import (
    STEP,
    VOLUME,
    Plate,
    Points,
    bulk_volume,
    layered_points,
    make_engine,
    particle_diameter,
)
from machine_sim.dem import ParticleEngine, Pose
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["EMPTY_ANNULUS", "OPENINGS", "Flow", "flow_exponent", "measure_outflow"]

OPENINGS = (5.0, 7.0, 10.0, 14.0)
"""Diameters of the hole, in particle diameters; below 5 particles jam (Zuriguel et al., Phys. Rev.
E 71 (2005) 051303)."""

EMPTY_ANNULUS = 1.4
"""k of the law: reduction of the hole diameter, in particle diameters."""
_COEFFICIENT = 0.58
"""C of the law."""
_BIN_WIDTH = 2.5
"""Width of the bin, in diameters of the hole."""
_FILL_DEPTH = 1.75
"""Depth of the soil, in diameters of the hole."""
_PACKING_DEPTH = 0.7
"""Height to which the packing fraction is measured, over that of the highest particle."""
_NUM_SIDES = 24
_FLOOR_HEIGHT = 1.0
"""Height of the bin's floor over the bench [m]."""
_INITIAL_SPACING = 1.3
"""Distance of particles as they are put in, in diameters."""
_REFILL_SPEED = 1.0
"""Speed of the particles that are put back, so that they leave before the next [m/s]."""
_SETTLE_TIME = 1.5
"""Duration of settling in the bin [s]."""
_START_TIME = 2.0
"""Time until the flow is steady, in units of sqrt(D/g), in which a body falls D / 2."""
_JAM_TIME = 10.0
"""Time without outflow after which the bin counts as jammed [s]."""
_NUM_RATE_SAMPLES = 8
"""Number of parts of the steady flow, whose scatter gives the standard error."""
_IDENTITY_POSE: Pose = (np.eye(3), np.zeros(3))
_BIN, _GATE = 0, 1
"""Tool numbers."""


@dataclass(frozen=True)
class Flow:
    """Steady flow through a hole.

    Attributes:
        opening: diameter of the hole, in particle diameters.
        rate: particles per second.
        error: standard error of the rate, relative to the rate.
        packing: volume of the particles over that of the soil in the bin, before the outflow.
        expected_rate: rate by Beverloo's law with C = 0.58 and k = 1.4 [particles/s].
        num_particles: number of particles in the bin, which is kept full.
        num_tunnelled: number of particles that passed through a plate.
    """

    opening: float
    rate: float
    error: float
    packing: float
    expected_rate: float
    num_particles: int
    num_tunnelled: int

    @property
    def coefficient(self) -> float:
        """C of the law for the measured rate."""
        return _COEFFICIENT * self.rate / self.expected_rate


def measure_outflow(
    soil: LooseSoil,
    opening_in_diameters: float,
    count: int | None = None,
    *,
    passing: int = 8000,
    **params: float,
) -> Flow:
    """Measure the outflow of a bin; particles that left are put back on top.

    Args:
        soil: the soil.
        opening_in_diameters: diameter of the hole, in particle diameters.
        count: number of particles in the bin; None for a depth of 1.75 hole diameters.
        passing: number of particles that leave during the measurement.
        params: further parameters of `ParticleParams`.

    Raises:
        ValueError: the bin jams.
    """
    trial = make_engine(soil, **params)
    d = particle_diameter(trial)
    hole = opening_in_diameters * d
    radius = 0.5 * _BIN_WIDTH * hole
    if count is None:
        count = round(_FILL_DEPTH * hole * math.pi * radius**2 / bulk_volume(trial, 1))
    engine = make_engine(soil, **{"capacity": 2 * count + 1000, **params})
    points = _fill_points(radius, d, count, 0.0)
    points[:, 2] += _FLOOR_HEIGHT + 0.6 * d
    height = float(points[:, 2].max()) + 5.0 * d
    engine.add_tool(_BIN, _bin(hole, radius, height), _IDENTITY_POSE, is_digging=False)
    engine.add_tool(_GATE, _gate(hole), _IDENTITY_POSE, is_digging=False)
    engine.add(points, np.zeros_like(points), VOLUME, grow=False)
    for _ in range(round(_SETTLE_TIME / STEP)):
        engine.step(STEP)
    packing = _packing_fraction(engine, radius)
    engine.remove_tool(_GATE)
    start = round(_START_TIME * math.sqrt(hole / engine.params.gravity) / STEP)
    num_out = _run(engine, radius, d, start, passing)
    times = STEP * np.arange(len(num_out))
    steady = np.arange(start, len(num_out))
    rate = float(np.polyfit(times[steady], num_out[steady], 1)[0])
    samples = [
        np.polyfit(times[k], num_out[k], 1)[0] for k in np.array_split(steady, _NUM_RATE_SAMPLES)
    ]
    error = float(np.std(samples, ddof=1)) / rate / math.sqrt(_NUM_RATE_SAMPLES)
    effective = hole - EMPTY_ANNULUS * d
    gravity = engine.params.gravity
    number_density = packing / (math.pi / 6.0 * d**3)
    expected = _COEFFICIENT * number_density * math.sqrt(gravity) * effective**2.5
    return Flow(
        opening_in_diameters, rate, error, packing, expected, count, engine.num_plate_tunnellings
    )


def flow_exponent(flows: Sequence[Flow]) -> float:
    """Return the exponent of the outflow law: the slope of log(W/rho) against log(D - 1.4 d)."""
    effective = np.log([flow.opening - EMPTY_ANNULUS for flow in flows])
    return float(np.polyfit(effective, np.log([flow.rate / flow.packing for flow in flows]), 1)[0])


def _run(
    engine: ParticleEngine, radius: float, d: float, start: int, passing: int
) -> NDArray[np.int64]:
    """Step until `passing` particles have left after step `start`.

    Returns:
        The total number of particles that have left after each step, shape (steps,).

    Raises:
        ValueError: no particle leaves for 10 s.
    """
    out = to_refill = num_layers = 0
    layer = int(0.9 * math.pi * (radius - 0.8 * d) ** 2 / (_INITIAL_SPACING * d) ** 2)
    num_out: list[int] = []
    while len(num_out) <= start or out < num_out[start] + passing:
        engine.step(STEP)
        has_left = engine.positions[:, 2] < _FLOOR_HEIGHT - d
        if has_left.any():
            engine.remove(engine.ids[has_left])
            out += int(has_left.sum())
            to_refill += int(has_left.sum())
        if to_refill >= layer:
            to_refill, num_layers = to_refill - layer, num_layers + 1
            points = _fill_points(radius, d, layer, num_layers)
            # Above all other particles, and fast enough to leave before the next layer.
            points[:, 2] += float(engine.positions[:, 2].max()) + 1.5 * d
            engine.add(
                points, np.full(points.shape, [0.0, 0.0, -_REFILL_SPEED]), VOLUME, grow=False
            )
        num_out.append(out)
        jam_steps = round(_JAM_TIME / STEP)
        if len(num_out) > jam_steps and out == num_out[-jam_steps]:
            raise ValueError(
                f"the bin is jammed: no outflow for {_JAM_TIME:g} s, after {out} particles"
            )
    return np.asarray(num_out, dtype=np.int64)


def _packing_fraction(engine: ParticleEngine, radius: float) -> float:
    """Return the packing fraction in the bin, without the layers at the floor and at the surface.

    Args:
        engine: the particles, at rest.
        radius: inner radius of the bin [m].
    """
    d = particle_diameter(engine)
    z = engine.positions[:, 2] - _FLOOR_HEIGHT
    low, high = d, _PACKING_DEPTH * float(z.max())

    def volume_below(height: float) -> float:
        """Return the volume of all particles below a height over the floor [m^3]."""
        h = np.clip(height - z + 0.5 * d, 0.0, d)
        return float((math.pi * h**2 * (0.5 * d - h / 3.0)).sum())

    slab = math.pi * radius**2 * (high - low)
    return (volume_below(high) - volume_below(low)) / slab


def _fill_points(radius: float, d: float, count: int, angle: float) -> Points:
    """Return points [m] that fill a bin, in layers from 0 up, rotated by `angle` [rad] about z."""
    inner = radius - 0.8 * d
    points = layered_points(
        lambda xy: np.hypot(xy[:, 0], xy[:, 1]) < inner, radius, _INITIAL_SPACING * d, count, 0.0
    )
    c, s = math.cos(angle), math.sin(angle)
    points[:, :2] = points[:, :2] @ np.array([[c, s], [-s, c]])
    return points


def _ring(radius: float, height: float) -> list[tuple[float, float, float]]:
    """Return the corners of a closed regular polygon [m]."""
    angle = 2.0 * math.pi / _NUM_SIDES * np.arange(_NUM_SIDES + 1)
    return [(radius * math.cos(a), radius * math.sin(a), height) for a in angle]


def _rim(hole: float) -> list[tuple[float, float, float]]:
    """Return the corners of a polygon with the area of a round hole."""
    area_ratio = 0.5 * _NUM_SIDES / math.pi * math.sin(2.0 * math.pi / _NUM_SIDES)
    return _ring(0.5 * hole / math.sqrt(area_ratio), _FLOOR_HEIGHT)


def _bin(hole: float, radius: float, height: float) -> list[Plate]:
    """Return the plates of the walls of a bin and of the floor around its hole."""
    outer = radius / math.cos(math.pi / _NUM_SIDES)
    low, top, rim = _ring(outer, _FLOOR_HEIGHT), _ring(outer, height), _rim(hole)
    walls = [[low[k], low[k + 1], top[k + 1], top[k]] for k in range(_NUM_SIDES)]
    return walls + [[rim[k], low[k], low[k + 1], rim[k + 1]] for k in range(_NUM_SIDES)]


def _gate(hole: float) -> list[Plate]:
    """Return the plates that close the hole, level with the floor."""
    rim = _rim(hole)
    return [[(0.0, 0.0, _FLOOR_HEIGHT), *rim[k : k + 7]] for k in range(0, _NUM_SIDES, 6)]
