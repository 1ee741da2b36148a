"""Measure the parts of a dig cycle, and the soil's time per tick against the size of the map.

    python -m benchmarks.dig_cycle_cost

Runs the first cycle of the demo in one process, with its particles of 1 litre and with smaller
ones, and prints the mean wall time per tick of each part; then a scripted scoop on maps of
growing size.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks.bucket_sweeps import NO_DEPOSIT_REQUESTS, bucket_sweep
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from benchmarks.timing import elapsed_ms, interleave
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import SingleProcessDig
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil

RUNS = 3
VOLUMES = (1_000_000, 330_000)
"""Nominal bank volumes of a particle [mm^3]: the demo's, and one that gives 3,000 particles."""
SIZES = (129, 257, 513, 1025)
"""Numbers of rows and columns of the maps."""
SCOOP_TICKS = 300
PROFILE = ((0.0, 0.0), (-0.24, 0.28), (-0.5, 0.53), (-0.79, 0.7), (-1.1, 0.68))
"""(x, z) of the bucket's key points from its lip [m]."""


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
    measure_scoops(as_json=options.json)


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


def measure_scoops(*, as_json: bool) -> None:
    """Print the soil's time per tick while a bucket is dragged 3 m, on maps of 0.2 m columns."""
    table = ResultTable([Column("median tick")], as_json=as_json)
    table.print_note("\nTick of the soil during a scoop, ms")
    table.print_header("columns")
    for size in SIZES:
        table.print_row(f"{size} x {size}", [statistics.median(time_scoop(size))])


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


def time_scoop(size: int) -> list[float]:
    """Return the wall time of each tick [ms] of a 1.2 m bucket at 0.3 m depth, 10 mm a tick."""
    grid = Grid(size, size, 0.2)
    soil = Soil(grid, np.zeros(grid.shape))
    times = []
    for tick in range(SCOOP_TICKS):
        x = -1.5 + 0.01 * tick
        sweep = bucket_sweep((x, 0.0, -0.3), (x + 0.01, 0.0, -0.3), PROFILE)
        times.append(elapsed_ms(partial(soil.step, tick, sweep, NO_DEPOSIT_REQUESTS)))
    return times


if __name__ == "__main__":
    main()
