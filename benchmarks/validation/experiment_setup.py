"""Level ground, containers, and particles to fill them, shared by the experiments."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import ParticleEngine, ParticleParams
from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil

STEP = 0.005
"""Physics step [s]."""
VOLUME = 1_000_000
"""Bank volume of a particle [mm^3]."""

Points = NDArray[np.float64]
Plate = list[tuple[float, float, float]]


def make_engine(soil: LooseSoil, *, size: float = 40.0, **params: float) -> ParticleEngine:
    """Return an engine over level ground of `size` [m]."""
    cells = math.ceil(size / 0.25)
    ground = Ground(Grid(cells, cells, 0.25), np.zeros((cells, cells)))
    particle_params = ParticleParams.from_mapping({"nominal_volume": VOLUME, **params})
    return ParticleEngine(particle_params, ground, soils=(soil,))


def particle_diameter(engine: ParticleEngine) -> float:
    """Return the diameter of a particle of bank volume `VOLUME` [m]."""
    trial = ParticleEngine(engine.params, engine.ground, soils=engine.soils)
    trial.add([[0.0, 0.0, 1.0]], [[0.0, 0.0, 0.0]], VOLUME)
    return 2.0 * float(trial.radii[0])


def bulk_volume(engine: ParticleEngine, count: int) -> float:
    """Return the loose volume of `count` particles [m^3]."""
    return count * VOLUME * 1e-9 * (1.0 + engine.soils[0].swell)


def tube_plates(radius: float, height: float, sides: int = 32) -> list[Plate]:
    """Return the plates of a vertical tube without floor around a circle of `radius` [m]."""
    outer = radius / math.cos(math.pi / sides)
    angle = np.linspace(0.0, 2.0 * math.pi, sides + 1)
    x, y = outer * np.cos(angle), outer * np.sin(angle)
    return [
        [(x[k], y[k], 0.0), (x[k + 1], y[k + 1], 0.0), (x[k + 1], y[k + 1], height),
         (x[k], y[k], height)]
        for k in range(sides)
    ]  # fmt: skip


def wall_plate(x0: float, y0: float, x1: float, y1: float, height: float) -> Plate:
    """Return a vertical plate on a line from (x0, y0) to (x1, y1) [m]."""
    return [(x0, y0, 0.0), (x1, y1, 0.0), (x1, y1, height), (x0, y0, height)]


def layered_points(
    inside: Callable[[Points], NDArray[np.bool_]],
    half: float,
    spacing: float,
    count: int,
    bottom: float,
) -> Points:
    """Return points [m] in horizontal layers, each shifted at random, shape (count, 3).

    Args:
        inside: returns a mask of the points (x, y), shape (n, 2), that lie in the container.
        half: half the side of a square about the origin that contains the container [m].
        spacing: spacing of points and layers [m].
        count: number of points.
        bottom: height of the lowest layer [m].

    Raises:
        ValueError: a layer has no point in the container.
    """
    rng = np.random.default_rng(0)
    axis = np.arange(-half, half + spacing, spacing)
    layers: list[Points] = []
    while sum(map(len, layers)) < count:
        x, y = np.meshgrid(axis + rng.uniform(0, spacing), axis + rng.uniform(0, spacing))
        xy = np.column_stack([x.ravel(), y.ravel()])
        xy = xy[inside(xy)]
        if not len(xy):
            raise ValueError("the container is narrower than a particle; use more particles")
        z = np.full((len(xy), 1), bottom + spacing * len(layers))
        layers.append(np.hstack([xy, z]))
    points = np.concatenate(layers)[:count]
    return np.asarray(points + rng.uniform(-0.11, 0.11, points.shape) * spacing)


def settle(engine: ParticleEngine, *, min_time: float = 0.5, max_time: float = 15.0) -> float:
    """Step until the particles are at rest, and return the time [s].

    At rest, the kinetic energy is below 1e-6 of weight times diameter. The test begins after
    `min_time` [s], when no particle is in the air, and ends at `max_time` [s].
    """
    weight = float(engine.masses.sum()) * engine.params.gravity
    limit = 1e-6 * weight * 2.0 * float(engine.radii.mean())
    for k in range(round(max_time / STEP)):
        engine.step(STEP)
        if k * STEP > min_time and engine.kinetic_energy < limit:
            break
    return (k + 1) * STEP
