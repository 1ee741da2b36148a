"""Outflow of a bin through a round hole in its level floor, against Beverloo's law.

Beverloo, Leniger, van de Velde: The flow of granular solids through orifices, Chem. Eng. Sci. 15
(1961) 260-269, doi:10.1016/0009-2509(61)85030-6: W = C rho sqrt(g) (D - k d)^2.5, for a hole of
diameter D and grains of diameter d, with C = 0.58 and k = 1.4, rho the density of the soil as it
lies in the bin. Neither depth nor width of the bin matter where both are well above D.

k is that of sand, and the law is an approximation: beads measured over a wide range of holes leave
it both ways (Mankoc et al., Granular Matter 9 (2007) 407, doi:10.1007/s10035-007-0062-2). So the
exponent comes from as wide a range as flows without jamming and is quick enough.
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

__all__ = ["OPENINGS", "Flow", "flow_exponent", "outflow", "outflows"]

OPENINGS = (5.0, 7.0, 10.0, 14.0)
"""Diameters of the hole, in diameters of the particles; below 5 they jam (Zuriguel et al., Phys.
Rev. E 71 (2005) 051303)."""

_EMPTY_ANNULUS = 1.4
"""Width of the hole's edge through which no centre comes, in particle diameters: k."""
_COEFFICIENT = 0.58
"""C of the law."""
_BIN_WIDTH = 2.5
"""Width of the bin, in diameters of the hole."""
_FILL_DEPTH = 1.75
"""Depth of the soil, in diameters of the hole."""
_NUM_SIDES = 24
_FLOOR_HEIGHT = 1.0
"""Height of the bin's floor over the bench [m]."""
_INITIAL_SPACING = 1.3
"""Distance of particles as they are put in, in diameters."""
_REFILL_SPEED = 1.0
"""Speed at which soil is put back [m/s]: away before the next comes."""
_SETTLE_TIME = 1.5
"""Time the soil has to settle in the bin [s]."""
_START_TIME = 2.0
"""Time before the flow is steady, over sqrt(D/g), in which one falls half a hole's diameter."""
_JAM_TIME = 10.0
"""Time in which nothing falls out of a bin that counts as jammed [s]."""
_NUM_RATE_SAMPLES = 8
"""Of the steady part, compared to tell its error."""
_IDENTITY_POSE: Pose = (np.eye(3), np.zeros(3))
_BIN, _GATE = 0, 1


@dataclass(frozen=True)
class Flow:
    """What flows through a hole, once it flows steadily.

    Attributes:
        opening: diameter of the hole, in particle diameters.
        rate: particles per second.
        error: of the rate, over the rate: standard error of the means of its parts.
        law: rate by Beverloo's law with C = 0.58 and k = 1.4.
        particles: number of particles in the bin, which is kept full.
        tunnelled: number of particles that passed through a plate.
    """

    opening: float
    rate: float
    error: float
    law: float
    particles: int
    tunnelled: int

    @property
    def coefficient(self) -> float:
        """C of the law."""
        return _COEFFICIENT * self.rate / self.law


def outflow(
    soil: LooseSoil,
    opening_in_diameters: float,
    count: int | None = None,
    *,
    passing: int = 8000,
    **params: float,
) -> Flow:
    """Outflow of a bin in which what fell out is put back on top.

    Args:
        soil: its soil.
        opening_in_diameters: diameter of the hole, in diameters of the particles.
        count: particles in the bin; without it so many that they stand 1.75 holes deep.
        passing: how many fall out while the rate is measured.
        params: of `ParticleParams`.

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
    points = _block(radius, d, count, 0.0)
    points[:, 2] += _FLOOR_HEIGHT + 0.6 * d
    height = float(points[:, 2].max()) + 5.0 * d
    engine.add_tool(_BIN, _bin(hole, radius, height), _IDENTITY_POSE, is_digging=False)
    engine.add_tool(_GATE, _gate(hole), _IDENTITY_POSE, is_digging=False)
    engine.add(points, np.zeros_like(points), VOLUME, grow=False)
    for _ in range(round(_SETTLE_TIME / STEP)):
        engine.step(STEP)
    engine.remove_tool(_GATE)
    start = round(_START_TIME * math.sqrt(hole / engine.params.gravity) / STEP)
    fallen = _run(engine, radius, d, start, passing)
    times = STEP * np.arange(len(fallen))
    steady = np.arange(start, len(fallen))
    rate = float(np.polyfit(times[steady], fallen[steady], 1)[0])
    parts = [
        np.polyfit(times[k], fallen[k], 1)[0] for k in np.array_split(steady, _NUM_RATE_SAMPLES)
    ]
    error = float(np.std(parts, ddof=1)) / rate / math.sqrt(_NUM_RATE_SAMPLES)
    effective = hole - _EMPTY_ANNULUS * d
    law = _COEFFICIENT / bulk_volume(engine, 1) * math.sqrt(engine.params.gravity) * effective**2.5
    return Flow(opening_in_diameters, rate, error, law, count, engine.num_plate_tunnellings)


def outflows(
    soil: LooseSoil, openings: Sequence[float] = OPENINGS, *, passing: int = 8000, **params: float
) -> list[Flow]:
    """Outflow through each of some openings; see `outflow`."""
    return [outflow(soil, opening, None, passing=passing, **params) for opening in openings]


def flow_exponent(flows: Sequence[Flow]) -> float:
    """Exponent of the law that outflows follow: slope of log W against log(D - 1.4 d)."""
    wide = np.log([flow.opening - _EMPTY_ANNULUS for flow in flows])
    return float(np.polyfit(wide, np.log([flow.rate for flow in flows]), 1)[0])


def _run(
    engine: ParticleEngine, radius: float, d: float, start: int, passing: int
) -> NDArray[np.int64]:
    """Step until so many fell out after step `start`; returns how many had after each step."""
    out = due = batch = 0
    layer = int(0.9 * math.pi * (radius - 0.8 * d) ** 2 / (_INITIAL_SPACING * d) ** 2)
    fallen: list[int] = []
    while len(fallen) <= start or out < fallen[start] + passing:
        engine.step(STEP)
        gone = engine.positions[:, 2] < _FLOOR_HEIGHT - d
        if gone.any():
            engine.remove(engine.ids[gone])
            out += int(gone.sum())
            due += int(gone.sum())
        if due >= layer:
            due, batch = due - layer, batch + 1
            points = _block(radius, d, layer, batch)
            # Above all others, and away before the next layer comes.
            points[:, 2] += float(engine.positions[:, 2].max()) + 1.5 * d
            engine.add(
                points, np.full(points.shape, [0.0, 0.0, -_REFILL_SPEED]), VOLUME, grow=False
            )
        fallen.append(out)
        still = round(_JAM_TIME / STEP)
        if len(fallen) > still and out == fallen[-still]:
            raise ValueError(
                f"the bin jams: nothing falls out for {_JAM_TIME} s, after {out} particles"
            )
    return np.asarray(fallen, dtype=np.int64)


def _block(radius: float, d: float, count: int, turn: float) -> Points:
    """Points [m] to fill a bin with, in layers from 0 up, turned by `turn` [rad]."""
    room = radius - 0.8 * d
    points = layered_points(
        lambda at: np.hypot(at[:, 0], at[:, 1]) < room, radius, _INITIAL_SPACING * d, count, 0.0
    )
    c, s = math.cos(turn), math.sin(turn)
    points[:, :2] = points[:, :2] @ np.array([[c, s], [-s, c]])
    return points


def _ring(radius: float, height: float) -> list[tuple[float, float, float]]:
    angle = 2.0 * math.pi / _NUM_SIDES * np.arange(_NUM_SIDES + 1)
    return [(radius * math.cos(a), radius * math.sin(a), height) for a in angle]


def _rim(hole: float) -> list[tuple[float, float, float]]:
    """Corners of a polygon as large as a round hole."""
    share = 0.5 * _NUM_SIDES / math.pi * math.sin(2.0 * math.pi / _NUM_SIDES)
    return _ring(0.5 * hole / math.sqrt(share), _FLOOR_HEIGHT)


def _bin(hole: float, radius: float, height: float) -> list[Plate]:
    """Walls of a bin, and the floor around its hole."""
    outer = radius / math.cos(math.pi / _NUM_SIDES)
    low, top, rim = _ring(outer, _FLOOR_HEIGHT), _ring(outer, height), _rim(hole)
    walls = [[low[k], low[k + 1], top[k + 1], top[k]] for k in range(_NUM_SIDES)]
    return walls + [[rim[k], low[k], low[k + 1], rim[k + 1]] for k in range(_NUM_SIDES)]


def _gate(hole: float) -> list[Plate]:
    """What closes the hole, level with the floor."""
    rim = _rim(hole)
    return [[(0.0, 0.0, _FLOOR_HEIGHT), *rim[k : k + 7]] for k in range(0, _NUM_SIDES, 6)]
