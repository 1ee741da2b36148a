"""Measure the parts of a dig cycle, and what it costs on larger maps.

    python -m benchmarks.dig_cycle_cost

Runs the first cycle of the demo in one process, with its particles of 1 litre and with smaller
ones, and prints the mean wall time per tick of each part; then real-time factor and memory of such
a cycle on level maps of growing size (3 GB for the largest one).
"""

from __future__ import annotations

import dataclasses
import resource
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from benchmarks.timing import interleave
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import SingleProcessDig
from msg_bridge.contract.grid import Grid
from soil_sim.terrain import HeightMap

RUNS = 3
VOLUMES = (1_000_000, 330_000)
"""Nominal bank volumes of a particle [mm^3]: the demo's, and one that gives 3,000 particles."""
SIZES = (257, 1025, 4097)
"""Numbers of rows and columns of the maps, of columns of 0.2 m."""


class CycleCost(NamedTuple):
    """Cost of a dig cycle.

    Attributes:
        real_time_factor: simulated over wall time.
        parts: mean wall time per tick [ms] of each part.
        max_particles: maximum number of particles at once.
    """

    real_time_factor: float
    parts: dict[str, float]
    max_particles: int


def main() -> None:
    """Measure and print both tables."""
    options = make_parser(__doc__, runs=RUNS).parse_args()
    measure_parts(options.runs, as_json=options.json)
    measure_sizes(options.runs, as_json=options.json)


def measure_parts(runs: int, *, as_json: bool) -> None:
    """Print the mean wall time per tick of each part of the demo's first cycle."""
    run_cycle(VOLUMES[0])  # compiles kernels and reads files
    costs = interleave([partial(run_cycle, volume) for volume in VOLUMES], runs)
    by_volume = list(zip(*costs, strict=True))
    columns = [Column(f"{1e-6 * volume:g} L") for volume in VOLUMES]
    table = ResultTable(columns, as_json=as_json)
    table.print_note(describe_load())
    table.print_note("One dig cycle of the demo, mean ms per tick of 10 ms, by particle volume")
    table.print_header()
    for part in costs[0][0].parts:
        medians = [statistics.median(cost.parts[part] for cost in each) for each in by_volume]
        table.print_row(part, medians)
    factors = [statistics.median(cost.real_time_factor for cost in each) for each in by_volume]
    table.print_row("real-time factor", factors, unit="")
    counts = [float(each[0].max_particles) for each in by_volume]
    table.print_row("max particles", counts, unit="", texts=[f"{count:.0f}" for count in counts])


def measure_sizes(runs: int, *, as_json: bool) -> None:
    """Print what the demo's first cycle costs on level maps of growing size."""
    columns = [Column("real-time factor"), Column("peak memory [GB]")]
    table = ResultTable(columns, as_json=as_json)
    table.print_note("\nThe cycle without timers, and the peak memory of the process so far")
    table.print_header("columns")
    for size in SIZES:
        factors = [run_on_level_map(size) for _ in range(runs)]
        memory = 1024e-9 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # in KiB on Linux
        table.print_row(f"{size} x {size}", [statistics.median(factors), memory], unit="")


def run_on_level_map(size: int) -> float:
    """Return the real-time factor of the demo's first cycle on a level map."""
    grid = Grid(size, size, 0.2)
    site = HeightMap(grid, np.zeros(grid.shape))
    dig = SingleProcessDig(load_run_config("demo.yaml", {"cycles": 1}), site)
    outcome = dig.run()
    dig.close()
    return outcome.simulated_time / outcome.wall_time


def run_cycle(nominal_volume: int) -> CycleCost:
    """Run the demo's first cycle with particles of a nominal bank volume [mm^3]."""
    config = load_run_config("demo.yaml", {"cycles": 1})
    particles = dataclasses.replace(config.particles, nominal_volume=nominal_volume)
    dig = SingleProcessDig(dataclasses.replace(config, particles=particles))
    seconds: dict[str, float] = {}
    machine, world = dig.machine, dig.world
    add_timer(world, "step", "machine, soil, exchange", seconds)
    add_timer(machine, "step", "machine", seconds)
    add_timer(machine.particles, "step", "  of it particles", seconds)
    add_timer(machine.machine, "before_step", "  of it tracks, motors", seconds)
    add_timer(world.soil, "step", "soil", seconds)
    add_timer(dig.task, "command", "operator", seconds)
    outcome = dig.run()
    dig.close()
    num_ticks = outcome.simulated_time / dig.config.stepping.tick_period
    parts = {name: 1e3 * total / num_ticks for name, total in seconds.items()}
    return CycleCost(outcome.simulated_time / outcome.wall_time, parts, outcome.max_particles)


def add_timer(owner: Any, name: str, part: str, seconds: dict[str, float]) -> None:
    """Replace the method `name` of `owner`: its calls add their wall time to `seconds[part]`."""
    method: Callable[..., Any] = getattr(owner, name)
    seconds[part] = 0.0

    def timed(*args: Any, **options: Any) -> Any:
        start = time.perf_counter()
        result = method(*args, **options)
        seconds[part] += time.perf_counter() - start
        return result

    setattr(owner, name, timed)


if __name__ == "__main__":
    main()
