"""What a 5 ms step of N particles costs: falling to a heap, at rest, carried in a moving bucket.

Prints a table of median wall time per step over several runs. Run from the repository root:
`python benchmarks/particles.py`.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground import Ground
from machine_sim.particles import ParticleEngine, ParticleParams, Pose, warm_up
from msg_bridge.contract.grid import Grid

STEP = 0.005
COUNTS = (500, 2000, 5000, 10000)
RUNS = 3


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


def timed(engine: ParticleEngine, steps: int) -> float:
    """Median wall time of a step [ms]."""
    times = []
    for _ in range(steps):
        start = time.perf_counter()
        engine.step(STEP)
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def heap(count: int) -> tuple[float, float]:
    """A column that collapses to a heap [ms a step]: falling, settled."""
    engine = ParticleEngine(ParticleParams(), flat_ground())
    spacing = 0.09
    points = block(count, spacing, spacing * count ** (1 / 3), 0.3)
    engine.add(points, np.zeros_like(points), 500_000, grow=False)
    falling = timed(engine, 160)
    for _ in range(500):
        engine.step(STEP)
    return falling, timed(engine, 60)


def bucket(count: int) -> float:
    """Soil carried in a box that lifts and swings [ms a step]."""
    engine = ParticleEngine(ParticleParams(), flat_ground())
    width = 1.1 * 0.09 * count ** (1 / 3)
    pose: Pose = (np.eye(3), np.array([0.0, 0.0, 1.0]))
    engine.add_tool(0, box(width, 2.0 * width), pose)
    points = block(count, 0.09, width - 0.2, 1.06)
    engine.add(points, np.zeros_like(points), 500_000, grow=False)
    for _ in range(150):
        engine.step(STEP)
    times = []
    for k in range(200):
        angle = 0.2 * np.sin(0.01 * k)
        turn = np.array(
            [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        )
        new: Pose = (turn, np.array([1.0 - np.cos(0.01 * k), 0.0, 1.0 + 0.005 * k]))
        engine.set_tool(0, pose, new)
        pose = new
        start = time.perf_counter()
        engine.step(STEP)
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def main() -> None:
    """Print the table."""
    warm_up()
    print("ms per 5 ms step (us per particle), median of", RUNS, "runs")
    print(f"{'N':>6} {'falling':>16} {'settled':>16} {'moving bucket':>16}")
    for count in COUNTS:
        runs = np.array([(*heap(count), bucket(count)) for _ in range(RUNS)])
        cells = (f"{t:8.3f} ({1e3 * t / count:.2f})" for t in np.median(runs, axis=0))
        print(f"{count:>6} " + " ".join(f"{cell:>16}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
