"""Small worlds for tests of particles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import ParticleEngine, ParticleParams, Pose
from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil

STEP = 0.005
LITRE = 1_000_000
"""Bank volume [mm^3]."""
LEVEL = np.eye(3)


def engine(
    *,
    slope: float = 0.0,
    soils: Sequence[LooseSoil] = (LooseSoil(swell=0.25),),
    **params: float,
) -> ParticleEngine:
    """An engine over a 16 m map whose height is `slope` * x."""
    grid = Grid(64, 64, 0.25)
    height = slope * grid.x(np.arange(64))[:, None] * np.ones((1, 64))
    given = ParticleParams.from_mapping(params)
    return ParticleEngine(given, Ground(grid, height), soils=soils)


def run(world: ParticleEngine, seconds: float) -> None:
    for _ in range(round(seconds / STEP)):
        world.step(STEP)


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, pitch: float = 0.0) -> Pose:
    """A pose turned by `pitch` [rad] about y."""
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), np.array([x, y, z])


def box(length: float, width: float, height: float) -> list[NDArray[np.float64]]:
    """Plates of an open box, floor centred on the tool frame's origin."""
    x, y = 0.5 * length, 0.5 * width
    corner = [(-x, -y), (x, -y), (x, y), (-x, y)]
    floor = np.array([(*c, 0.0) for c in corner])
    around = zip(corner, corner[1:] + corner[:1], strict=True)
    return [
        floor,
        *(np.array([(*a, 0.0), (*b, 0.0), (*b, height), (*a, height)]) for a, b in around),
    ]


def square(half: float) -> NDArray[np.float64]:
    """A level square plate about the tool frame's origin."""
    return np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0.0]])


def cloud(
    count: int, spacing: float, size: tuple[float, float], bottom: float
) -> NDArray[np.float64]:
    """Points [m] in layers, each shifted at random, on a footprint; shape (count, 3)."""
    rng = np.random.default_rng(7)
    nx, ny = max(1, int(size[0] / spacing)), max(1, int(size[1] / spacing))
    k = np.arange(count)
    layer = k // (nx * ny)
    grid = np.stack([k % nx - 0.5 * (nx - 1), k // nx % ny - 0.5 * (ny - 1), layer + 0.5], axis=1)
    shift = rng.uniform(-0.4, 0.4, (layer[-1] + 1, 2))
    grid[:, :2] += shift[layer]
    grid += rng.uniform(-0.02, 0.02, grid.shape)
    return np.asarray(grid * spacing + [0.0, 0.0, bottom])
