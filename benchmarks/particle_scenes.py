"""Blocks of soil that fall to a heap or are swung in a bucket, and how long their steps take.

The soil comes in lumps of half a litre: spheres of 83 mm, or cubes of 79 mm.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem import ParticleEngine, Pose
from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.grid import Grid

if TYPE_CHECKING:
    from machine_sim.reference_cubes import CubeEngine

STEP = 0.005  # [s]
VOLUME = 500_000  # bank, of a lump [mm^3]
SPACING = 0.09  # of the lumps of a block [m]
FALLING = 120  # steps until most of a block has come down

Engine: TypeAlias = "ParticleEngine | CubeEngine"


@dataclass(frozen=True)
class HeapShape:
    """What a heap looks like, to tell whether two are alike.

    Attributes:
        height: of all but the highest of its lumps, 1 in 200 [m].
        radius: that 98 % of its lumps lie within [m].
        contacts: how many others a lump touches, on average.
    """

    height: float
    radius: float
    contacts: float


def describe_load() -> str:
    """What else the machine has to do, for whoever reads the times."""
    return f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before"


def flat_ground() -> Ground:
    """A level 40 m map of 0.2 m columns."""
    return Ground(Grid(200, 200, 0.2), np.zeros((200, 200)))


def block(count: int, spacing: float, width: float, bottom: float) -> NDArray[np.float64]:
    """A jittered lattice of points [m] on a square footprint, shape (count, 3)."""
    side = max(1, int(width / spacing))
    layers = count // side**2 + 1
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in (layers, side, side)), indexing="ij"), -1)
    points = grid.reshape(-1, 3)[:count, ::-1] * spacing
    points += np.random.default_rng(1).uniform(-0.05, 0.05, points.shape) * spacing
    # Layers shifted at random: a lattice of aligned columns would stand as a tower.
    shift = np.random.default_rng(2).uniform(-0.5, 0.5, (layers, 2)) * spacing
    points[:, :2] += shift[np.arange(count) // side**2] - 0.5 * (side - 1) * spacing
    points[:, 2] += bottom
    return np.asarray(points, dtype=np.float64)


def box(width: float, height: float) -> list[list[tuple[float, float, float]]]:
    """Plates of an open box, floor centred on the tool frame's origin."""
    w, h = 0.5 * width, height
    corner = [(-w, -w), (w, -w), (w, w), (-w, w)]
    floor = [(*c, 0.0) for c in corner]
    sides = [
        [(*a, 0.0), (*b, 0.0), (*b, h), (*a, h)]
        for a, b in zip(corner, corner[1:] + corner[:1], strict=True)
    ]
    return [floor, *sides]


def time_steps(
    engine: Engine, steps: int, *, group: int = 1, before: Callable[[], None] | None = None
) -> float:
    """Wall time of a step [ms]: the mean of a group of steps, the median of the groups.

    Args:
        engine: what to step.
        steps: how many in all.
        group: how many belong together; all of them where each is unlike the others.
        before: done before each step and not timed.
    """
    times = np.zeros(steps)
    for k in range(steps):
        if before:
            before()
        start = time.perf_counter()
        engine.step(STEP)
        times[k] = time.perf_counter() - start
    return 1e3 * float(np.median([part.mean() for part in np.split(times, steps // group)]))


def add_block(
    engine: Engine,
    count: int,
    volume: ArrayLike = VOLUME,
    *,
    spacing: float = SPACING,
    moisture: int = 0,
    grow: bool = False,
) -> None:
    """Add a block as wide as it is high, 0.3 m above the ground.

    Args:
        engine: where to.
        count: how many lumps.
        volume: bank, of each or of all [mm^3].
        spacing: of the lumps [m].
        moisture: [% of saturation].
        grow: whether they start small, as when a machine digs them.
    """
    points = block(count, spacing, spacing * count ** (1 / 3), 0.3)
    engine.add(points, np.zeros_like(points), volume, moisture=moisture, grow=grow)


def settle_steps(count: int) -> int:
    """Steps after `FALLING` until a heap of `count` is at rest; of a great one, nearly."""
    return 600 if count <= 20_000 else 400


def run(engine: Engine, steps: int) -> None:
    """Steps that are not timed."""
    for _ in range(steps):
        engine.step(STEP)


def time_bucket(
    engine: Engine,
    count: int,
    volume: ArrayLike = VOLUME,
    *,
    spacing: float = SPACING,
    moisture: int = 0,
    grow: bool = False,
) -> float:
    """Soil in a box that lifts and swings [ms a step]; arguments as of `add_block`."""
    width = 1.1 * SPACING * count ** (1 / 3)
    pose: Pose = (np.eye(3), np.array([0.0, 0.0, 1.0]))
    engine.add_tool(0, box(width, 2.0 * width), pose)
    points = block(count, spacing, width - 0.2 if width > 0.5 else 0.7 * width, 1.06)
    engine.add(points, np.zeros_like(points), volume, moisture=moisture, grow=grow)
    run(engine, 150)
    poses = swing(100)

    def move() -> None:
        nonlocal pose
        start, pose = pose, next(poses)
        engine.set_tool_motion(0, start, pose)

    return time_steps(engine, 100, before=move)


def swing(steps: int) -> Iterator[Pose]:
    """Where a bucket is, step by step, that lifts and swings."""
    for k in range(steps):
        angle = 0.2 * np.sin(0.01 * k)
        turn = np.array(
            [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        )
        yield turn, np.array([1.0 - np.cos(0.01 * k), 0.0, 1.0 + 0.005 * k])


def measure_heap(position: NDArray[np.float64], radius: NDArray[np.floating]) -> HeapShape:
    """What spheres at `position` [m], shape (n, 3), with `radius` [m], shape (n,), look like."""
    around = position[:, :2] - position[:, :2].mean(axis=0)
    order = np.argsort(position[:, 0])
    pairs = _touching(position[order], radius[order].astype(np.float64))
    return HeapShape(
        height=float(np.quantile(position[:, 2] + radius, 0.995)),
        radius=float(np.quantile(np.hypot(*around.T), 0.98)),
        contacts=2.0 * pairs / len(position),
    )


@njit
def _touching(position, radius):  # type: ignore[no-untyped-def]
    """How many pairs of spheres touch; they come in the order of x."""
    pairs, widest = 0, radius.max()
    for i in range(radius.size):
        for j in range(i + 1, radius.size):
            reach = radius[i] + radius[j]
            dx = position[j, 0] - position[i, 0]
            if dx > radius[i] + widest:
                break
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            pairs += dx * dx + dy * dy + dz * dz < reach * reach
    return pairs
