"""What a 5 ms step of N particles costs: falling to a heap, settled, asleep, in a moving bucket.

Prints a table of median wall time per step; `--chart FILE` draws it. Run from the repository root:
`python benchmarks/particles.py`. `benchmarks/cubes.py` does the same beside cubes in pybullet.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from machine_sim.ground import Ground
from machine_sim.particles import ParticleEngine, ParticleParams, Pose, warm_up
from msg_bridge.contract.grid import Grid

STEP = 0.005
COUNTS = (200, 1000, 5000, 10_000, 20_000, 40_000, 100_000)
KINDS = ("falling", "settled", "asleep", "moving bucket")


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
    times: list[float] = []
    for _ in range(steps):
        start = time.perf_counter()
        engine.step(STEP)
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def heap(count: int) -> tuple[float, float, float]:
    """A block that falls to a heap [ms a step]: falling, settled but awake, asleep."""
    engine = ParticleEngine(ParticleParams(capacity=10**6, sleeping=False), flat_ground())
    points = block(count, 0.09, 0.09 * count ** (1 / 3), 0.3)
    engine.add(points, np.zeros_like(points), 500_000, grow=False)
    falling = timed(engine, 120)
    settle = 600 if count <= 20_000 else 400
    for _ in range(settle):
        engine.step(STEP)
    settled = timed(engine, 30)
    calm = ParticleEngine(ParticleParams(capacity=10**6, sleep_speed=0.05), flat_ground())
    calm.add(engine.store.position, np.zeros_like(engine.store.position), 500_000, grow=False)
    for _ in range(250):
        calm.step(STEP)
    return falling, settled, timed(calm, 60)


def bucket(count: int) -> float:
    """Soil carried in a box that lifts and swings, shaken enough to stay awake [ms a step]."""
    engine = ParticleEngine(ParticleParams(capacity=10**6, carried=False), flat_ground())
    width = 1.1 * 0.09 * count ** (1 / 3)
    pose: Pose = (np.eye(3), np.array([0.0, 0.0, 1.0]))
    engine.add_tool(0, box(width, 2.0 * width), pose)
    points = block(count, 0.09, width - 0.2 if width > 0.5 else 0.7 * width, 1.06)
    engine.add(points, np.zeros_like(points), 500_000, grow=False)
    for _ in range(150):
        engine.step(STEP)
    times = []
    for k in range(100):
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


def draw(counts: list[int], times: NDArray[np.float64], path: Path) -> None:
    """Chart of ms per step against N, with the line of real time."""
    figure, axes = plt.subplots(figsize=(7.5, 5.0))
    for k, kind in enumerate(KINDS):
        axes.loglog(counts, times[:, k], marker="o", label=kind)
    axes.axhline(1e3 * STEP, color="grey", linestyle="--", label="real time")
    axes.set(xlabel="particles", ylabel="ms per 5 ms step, one core")
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    figure.savefig(path, dpi=150, bbox_inches="tight")


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    options.add_argument("--chart", type=Path, help="draw ms per step against N into this file")
    given = options.parse_args()
    warm_up()
    print("ms per 5 ms step (us per particle), medians over steps")
    print(f"{'N':>7} " + " ".join(f"{kind:>16}" for kind in KINDS))
    rows = []
    for count in given.counts:
        rows.append([*heap(count), bucket(count)])
        cells = (f"{t:8.3f} ({1e3 * t / count:.3f})" for t in rows[-1])
        print(f"{count:>7} " + " ".join(f"{cell:>16}" for cell in cells), flush=True)
    if given.chart:
        draw(list(given.counts), np.array(rows), given.chart)


if __name__ == "__main__":
    main()
