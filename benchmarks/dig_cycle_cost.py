"""What a dig cycle costs, part by part, and how the soil's part grows with the map.

Runs the demo's first cycle in one process, with its particles of 1 litre and with smaller ones, and
prints the mean wall time per tick of each part; then one scripted scoop on maps of growing size.
Run from the repository root: `python benchmarks/dig_cycle_cost.py`.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np

from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import SingleProcessDig
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, Rows, empty_rows
from soil_sim.soil import Soil

RUNS = 3
VOLUMES = (1_000_000, 415_000)  # mm^3 bank: the demo's, and for 3,000 particles
SIZES = (129, 257, 513, 1025)
PROFILE = ((0.0, 0.0), (-0.24, 0.28), (-0.5, 0.53), (-0.79, 0.7), (-1.1, 0.68))


def main() -> None:
    """Print both tables."""
    cycle_by_part()
    scoop_by_size()


def cycle_by_part() -> None:
    """Mean wall time per tick of the parts of the demo's first cycle; medians of the runs."""
    _one_cycle(VOLUMES[0])  # what is compiled or read for the first time is not timed
    runs = [[_one_cycle(volume) for volume in VOLUMES] for _ in range(RUNS)]
    by_volume = list(zip(*runs, strict=True))
    print("one dig cycle of the demo, mean per tick of 10 ms")
    _print("particles at most", [f"{many[0][2]:8d}" for many in by_volume])
    for part in runs[0][0][1]:
        spent = [statistics.median(run[1][part] for run in many) for many in by_volume]
        _print(part, [f"{ms:8.3f}" for ms in spent], "ms")
    times = [statistics.median(run[0] for run in many) for many in by_volume]
    _print("times real time", [f"{value:8.1f}" for value in times])
    print()


def _print(label: str, columns: list[str], unit: str = "") -> None:
    print(f"  {label:<24}{''.join(columns)} {unit}")


def scoop_by_size() -> None:
    """Wall time per tick of the soil while a bucket is dragged 3 m, for maps of 0.2 m columns."""
    print("soil tick during a scoop, median")
    for size in SIZES:
        print(f"  {size:5d} x {size:<5d}{1e3 * statistics.median(_scoop(size)):8.3f} ms")


def _one_cycle(volume_mm3: int) -> tuple[float, dict[str, float], int]:
    """Times real time, ms per tick by part, and most particles."""
    config = load_run_config("demo.yaml", {"cycles": 1})
    particles = dataclasses.replace(config.particles, nominal_volume=volume_mm3)
    dig = SingleProcessDig(dataclasses.replace(config, particles=particles))
    spent: dict[str, float] = defaultdict(float)
    machine, world = dig.machine, dig.world
    _time(machine, "step", "machine side", spent)
    _time(machine.particles, "step", "  of it particles", spent)
    _time(machine.machine, "before_step", "  of it tracks, motors", spent)
    _time(world.soil, "step", "soil", spent)
    _time(world, "step", "machine, soil, exchange", spent)
    _time(dig.task, "command", "operator", spent)
    outcome = dig.run()
    dig.close()
    ticks = outcome.simulated_time / dig.config.stepping.tick_period
    parts = {name: 1e3 * seconds / ticks for name, seconds in spent.items()}
    return outcome.simulated_time / outcome.wall_time, parts, outcome.max_particles


def _time(owner: Any, name: str, part: str, spent: dict[str, float]) -> None:
    """Let calls of a method add their wall time to `spent[part]`."""
    method: Callable[..., Any] = getattr(owner, name)

    def timed(*args: Any, **options: Any) -> Any:
        start = time.perf_counter()
        result = method(*args, **options)
        spent[part] += time.perf_counter() - start
        return result

    setattr(owner, name, timed)


def _scoop(size: int) -> list[float]:
    """Wall time of each tick [s]."""
    grid = Grid(size, size, 0.2)
    soil = Soil(grid, np.zeros(grid.shape))
    nothing = empty_rows(DEPOSIT_REQUEST)
    times = []
    for tick in range(300):
        sweeps = _sweeps(-1.5 + 0.01 * tick)
        start = time.perf_counter()
        soil.step(tick, sweeps, nothing)
        times.append(time.perf_counter() - start)
    return times


def _sweeps(x: float) -> Rows:
    """A 1.2 m bucket at 0.3 m depth that moves 10 mm toward +x."""
    rows = empty_rows(SWEEP, 2 * len(PROFILE))
    for pair, (back, up) in enumerate(PROFILE):
        for side, y in ((0, 0.6), (1, -0.6)):
            row = rows[2 * pair + side]
            row["pair"], row["y0"], row["y1"] = pair, y, y
            row["x0"], row["x1"] = x + back, x + back + 0.01
            row["z0"] = row["z1"] = up - 0.3
    return rows


if __name__ == "__main__":
    main()
