"""Scenes of the particle benchmarks: a block that falls to a heap, and soil swung in a bucket.

Each lump of soil has a bank volume of half a litre: a sphere of 83 mm diameter, or a cube of 79 mm.
"""

from __future__ import annotations

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

STEP = 0.005
"""Physics step [s]."""

VOLUME = 500_000
"""Bank volume of a lump [mm^3]."""

SPACING = 0.09
"""Spacing of the lumps of a block [m]."""

FALLING_STEPS = 120
"""Steps until most of a block has reached the ground."""

REST_GROUP, REST_GROUPS = 20, 5
"""Number of steps at rest that are timed together, and number of such groups."""

Engine: TypeAlias = "ParticleEngine | CubeEngine"


@dataclass(frozen=True)
class HeapShape:
    """Size of a heap, to compare heaps of two programs.

    Attributes:
        height: 99.5th percentile of the tops of the lumps [m].
        radius: radius that contains 98 % of the lumps [m].
        contacts: mean number of contacts of a lump.
    """

    height: float
    radius: float
    contacts: float

    def is_similar(self, other: HeapShape, tolerance: float) -> bool:
        """Return whether every figure differs by less than `tolerance`, relative to `other`."""
        own_and_other = zip(
            (self.height, self.radius, self.contacts),
            (other.height, other.radius, other.contacts),
            strict=True,
        )
        return all(abs(a - b) < tolerance * b for a, b in own_and_other)


def flat_ground() -> Ground:
    """Return level ground of 40 m with columns of 0.2 m."""
    return Ground(Grid(200, 200, 0.2), np.zeros((200, 200)))


def block_points(count: int, spacing: float, width: float, bottom: float) -> NDArray[np.float64]:
    """Return points [m] of a jittered lattice on a square footprint, shape (count, 3).

    Args:
        count: number of points.
        spacing: lattice spacing [m].
        width: side of the footprint [m], centred on the origin.
        bottom: height of the lowest layer [m].
    """
    side = max(1, int(width / spacing))
    num_layers = count // side**2 + 1
    axes = (np.arange(n) for n in (num_layers, side, side))
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    points = lattice.reshape(-1, 3)[:count, ::-1] * spacing
    points += np.random.default_rng(1).uniform(-0.05, 0.05, points.shape) * spacing
    # Layers are shifted at random: a lattice of aligned columns would stand as a tower.
    shift = np.random.default_rng(2).uniform(-0.5, 0.5, (num_layers, 2)) * spacing
    points[:, :2] += shift[np.arange(count) // side**2] - 0.5 * (side - 1) * spacing
    points[:, 2] += bottom
    return np.asarray(points, dtype=np.float64)


def box_plates(width: float, height: float) -> list[list[tuple[float, float, float]]]:
    """Return the plates of an open box [m]; the middle of its floor is the tool frame's origin."""
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
    """Return the wall time of a step [ms]: the mean of each group of steps, median of the groups.

    Args:
        engine: the engine to step.
        steps: total number of steps.
        group: number of steps in a group; use `steps` if the cost changes from step to step.
        before: called before each step, not timed.
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
        engine: the engine that gets the block.
        count: number of lumps.
        volume: bank volume of each lump or of all lumps [mm^3].
        spacing: spacing of the lumps [m].
        moisture: [% of saturation].
        grow: whether lumps start small and grow, as when a machine digs them.
    """
    points = block_points(count, spacing, spacing * count ** (1 / 3), 0.3)
    engine.add(points, np.zeros_like(points), volume, moisture=moisture, grow=grow)


def settle_steps(count: int) -> int:
    """Return the steps after `FALLING_STEPS` until a heap is at rest (above 20,000: nearly)."""
    return 600 if count <= 20_000 else 400


def step_untimed(engine: Engine, steps: int) -> None:
    """Advance an engine without timing it."""
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
    """Return the wall time of a step [ms] of soil in a box that lifts and swings.

    The arguments are those of `add_block`.
    """
    width = 1.1 * SPACING * count ** (1 / 3)
    pose: Pose = (np.eye(3), np.array([0.0, 0.0, 1.0]))
    engine.add_tool(0, box_plates(width, 2.0 * width), pose)
    points = block_points(count, spacing, width - 0.2 if width > 0.5 else 0.7 * width, 1.06)
    engine.add(points, np.zeros_like(points), volume, moisture=moisture, grow=grow)
    step_untimed(engine, 150)
    poses = swing_poses(100)

    def move() -> None:
        nonlocal pose
        start, pose = pose, next(poses)
        engine.set_tool_motion(0, start, pose)

    return time_steps(engine, 100, before=move)


def swing_poses(steps: int) -> Iterator[Pose]:
    """Yield the pose of a bucket that lifts and swings, step by step."""
    for k in range(steps):
        angle = 0.2 * np.sin(0.01 * k)
        rotation = np.array(
            [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        )
        yield rotation, np.array([1.0 - np.cos(0.01 * k), 0.0, 1.0 + 0.005 * k])


def measure_heap(position: NDArray[np.float64], radius: NDArray[np.floating]) -> HeapShape:
    """Return the shape of a heap of spheres.

    Args:
        position: centres [m], shape (n, 3).
        radius: radii [m], shape (n,).
    """
    from_centre = position[:, :2] - position[:, :2].mean(axis=0)
    order = np.argsort(position[:, 0])
    num_pairs = _count_touching_pairs(position[order], radius[order].astype(np.float64))
    return HeapShape(
        height=float(np.quantile(position[:, 2] + radius, 0.995)),
        radius=float(np.quantile(np.hypot(*from_centre.T), 0.98)),
        contacts=2.0 * num_pairs / len(position),
    )


@njit
def _count_touching_pairs(position, radius):  # type: ignore[no-untyped-def]
    """Return the number of pairs of spheres that touch; the spheres are sorted by x."""
    num_pairs, max_radius = 0, radius.max()
    for i in range(radius.size):
        for j in range(i + 1, radius.size):
            reach = radius[i] + radius[j]
            dx = position[j, 0] - position[i, 0]
            if dx > radius[i] + max_radius:
                break
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            num_pairs += dx * dx + dy * dy + dz * dz < reach * reach
    return num_pairs
