"""Small scenes for tests of soil as particles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import ParticleEngine, ParticleParams, Pose, SoilEngine
from machine_sim.ground.contact_surface import Ground
from machine_sim.reference_cubes import CubeEngine, VelocityClamps
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil

STEP = 0.005
"""Time step [s]."""
LITRE = 1_000_000
"""Bank volume [mm^3]."""
LEVEL = np.eye(3)
"""Rotation of a tool whose axes are those of the map."""


def sloping_ground(slope: float = 0.0) -> Ground:
    """Return a map of 16 m by 16 m whose height is `slope` * x."""
    grid = Grid(64, 64, 0.25)
    return Ground(grid, slope * grid.x(np.arange(64))[:, None] * np.ones((1, 64)))


def engine(
    *,
    slope: float = 0.0,
    soils: Sequence[LooseSoil] = (LooseSoil(swell=0.25),),
    **params: float,
) -> ParticleEngine:
    """Return an engine without particles over `sloping_ground`."""
    return ParticleEngine(ParticleParams.from_mapping(params), sloping_ground(slope), soils=soils)


def cubes(
    *,
    slope: float = 0.0,
    soils: Sequence[LooseSoil] = (LooseSoil(swell=0.25),),
    clamps: VelocityClamps | None = None,
    **params: float,
) -> CubeEngine:
    """Return an engine without cubes over `sloping_ground`."""
    return CubeEngine(
        ParticleParams.from_mapping(params), sloping_ground(slope), soils=soils, clamps=clamps
    )


def run(world: SoilEngine, seconds: float) -> None:
    """Step an engine for a time [s]."""
    for _ in range(round(seconds / STEP)):
        world.step(STEP)


def drive(world: SoilEngine, poses: Iterable[Pose], tool_id: int = 0) -> None:
    """Move a tool from pose to pose, one in each step."""
    for _ in drive_steps(world, poses, tool_id):
        pass


def drive_steps(world: SoilEngine, poses: Iterable[Pose], tool_id: int = 0) -> Iterator[int]:
    """Move a tool from pose to pose, one in each step; yield the number of each step after it."""
    for k, (start, end) in enumerate(pairwise(poses)):
        world.set_tool_motion(tool_id, start, end)
        world.step(STEP)
        yield k


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, pitch: float = 0.0) -> Pose:
    """Return a pose that is rotated by `pitch` [rad] about y."""
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), np.array([x, y, z])


def box(length: float, width: float, height: float) -> list[NDArray[np.float64]]:
    """Return the plates of an open box, the floor first, centred on the tool frame's origin."""
    x, y = 0.5 * length, 0.5 * width
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    floor = np.array([(*corner, 0.0) for corner in corners])
    edges = zip(corners, corners[1:] + corners[:1], strict=True)
    return [
        floor,
        *(np.array([(*a, 0.0), (*b, 0.0), (*b, height), (*a, height)]) for a, b in edges),
    ]


def square(half: float) -> NDArray[np.float64]:
    """Return a horizontal square plate about the tool frame's origin."""
    return np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0.0]])


def cloud(
    count: int, spacing: float, size: tuple[float, float], bottom: float
) -> NDArray[np.float64]:
    """Return points [m] in layers, each shifted at random on the footprint, shape (count, 3)."""
    rng = np.random.default_rng(7)
    nx, ny = max(1, int(size[0] / spacing)), max(1, int(size[1] / spacing))
    k = np.arange(count)
    layer = k // (nx * ny)
    grid = np.stack([k % nx - 0.5 * (nx - 1), k // nx % ny - 0.5 * (ny - 1), layer + 0.5], axis=1)
    shift = rng.uniform(-0.4, 0.4, (layer[-1] + 1, 2))
    grid[:, :2] += shift[layer]
    grid += rng.uniform(-0.02, 0.02, grid.shape)
    return np.asarray(grid * spacing + [0.0, 0.0, bottom])
