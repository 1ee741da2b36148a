"""Measure a terrain split among regions beside one soil: balance, shape, and time of a tick.

    python -m benchmarks.split_terrain          # about two minutes
    python -m benchmarks.split_terrain --runs 1

First the operator of the demo digs one cycle over the border of two regions. Then as many scripted
buckets as regions are dragged, one in each region, in one soil and in the regions. The time of the
slowest region is that of a tick if each region has a processor.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from statistics import median
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from benchmarks.bucket_sweeps import NO_DEPOSIT_REQUESTS, bucket_sweep
from benchmarks.dig_cycle_cost import add_timer
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from benchmarks.timing import interleave
from dig_operator import DigTask
from earthmoving_sim.demo_site import jacksboro_site
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.world import World
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from machine_sim.warm_up import warm_up as warm_up_machines
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import SWEEP, Rows, join_rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.split_terrain import SplitSoil
from soil_sim.warm_up import warm_up as warm_up_soil

RUNS = 3
HALO = 32
"""[rows]"""
GRID = Grid(512, 128, 0.1)
NUM_REGIONS = (1, 2, 4)
START_X = -6.0
"""Position of the excavator: it digs to both sides of x = 0, the border of two regions [m]."""
DRAG_TICKS = 300
ROOM = 4_000_000
"""Bank volume that a bucket takes in in a tick; it pushes the rest ahead [mm^3]."""
SOIL = SoilParams(soil="loam")


class DigResult(NamedTuple):
    """Result of a dig cycle.

    Attributes:
        moved: excavated bank volume [m^3].
        imbalance: largest imbalance of the ledger [mm^3].
        heights: terrain after it [m], shape (rows, cols).
        crossed: bank volume that slid over the border [m^3].
    """

    moved: float
    imbalance: int
    heights: NDArray[np.float64]
    crossed: float


class DragResult(NamedTuple):
    """Result of dragging buckets.

    Attributes:
        tick: mean time of a tick of all regions together [ms].
        slowest: mean time of a tick of the slowest region [ms].
        excavated: bank volume [m^3].
        heights: terrain after it [m], shape (rows, cols).
    """

    tick: float
    slowest: float
    excavated: float
    heights: NDArray[np.float64]


def main() -> None:
    """Measure and print both tables."""
    options = make_parser(__doc__, runs=RUNS).parse_args()
    warm_up_soil(SOIL)
    compare_digs(as_json=options.json)
    compare_drags(options.runs, as_json=options.json)


def compare_digs(*, as_json: bool) -> None:
    """Print the dig cycle of the demo on one soil and on two regions."""
    one, split = dig_one_cycle(1), dig_one_cycle(2)
    difference = split.heights - one.heights
    table = ResultTable([Column("one soil", "m3"), Column("2 regions", "m3")], as_json=as_json)
    table.print_note("One dig cycle of the demo, over the border of two regions")
    table.print_header()
    table.print_row("excavated, m3", [one.moved, split.moved])
    table.print_row("slid over the border, m3", [None, split.crossed])
    table.print_row("largest imbalance, mm3", [one.imbalance, split.imbalance], unit="mm3")
    table.print_row("RMS difference of height, m", [None, float(difference.std())], unit="m")


def compare_drags(runs: int, *, as_json: bool) -> None:
    """Print the cost of dragging as many buckets as regions, in one soil and in regions."""
    columns = [Column(f"{count} buckets" if count > 1 else "1 bucket") for count in NUM_REGIONS]
    table = ResultTable(columns, as_json=as_json)
    table.print_note(
        f"\nA bucket dragged in each region. {describe_load()}; medians of {runs} runs"
    )
    table.print_header("ms per tick")
    cases = [partial(drag, buckets, regions) for buckets in NUM_REGIONS for regions in (1, buckets)]
    results = list(zip(*interleave(cases, runs), strict=True))
    one, split = results[::2], results[1::2]
    table.print_row("one soil", [median(each.tick for each in case) for case in one])
    table.print_row("all regions", [median(each.tick for each in case) for case in split])
    table.print_row("slowest region", [median(each.slowest for each in case) for case in split])
    ratios = [b[0].excavated / a[0].excavated for a, b in zip(one, split, strict=True)]
    table.print_row("excavated, over one soil", ratios, unit="")
    deviations = [
        float((b[0].heights - a[0].heights).std()) for a, b in zip(one, split, strict=True)
    ]
    table.print_row("RMS difference of height, m", deviations, unit="m")


def dig_one_cycle(num_regions: int) -> DigResult:
    """Run the demo's first cycle on its site, split among regions."""
    config = load_run_config("demo.yaml", {"cycles": 1})
    site = jacksboro_site()
    one = Soil(site.grid, site.heights, config.soil)
    warm_up_soil(config.soil)
    split = SplitSoil(site.grid, site.heights, config.soil, num_regions=num_regions, halo=HALO)
    sim = MachineSim(
        [Placement(config.machine, (START_X, config.run.start_y))],
        site.grid,
        one.columns.height,
        params=config.stepping,
        particle_params=config.particles,
        soils=one.loose_soils,
        seed=config.run.seed,
    )
    warm_up_machines([config.machine], config.stepping, config.particles)
    # The exchange and the operator use what both soils have.
    world = World(cast(Soil, split) if num_regions > 1 else one, {1: sim})
    task = DigTask(config.machine, config.behaviour, config.task)
    tick_period = config.stepping.tick_period
    operated = OperatedMachine(world, sim.simulated_machines[0], task, tick_period)
    imbalance, crossed = 0, 0
    while not task.done:
        if world.tick % 2 == 0:
            operated.observe_and_command(2 * tick_period)
        imbalance = max(imbalance, abs(world.step().imbalance))
        crossed += split.in_flight_mm3
    moved = sum(cycle.moved_volume for cycle in task.reports)
    heights = world.surface.copy()
    world.close()
    return DigResult(moved, imbalance, heights, 1e-9 * crossed)


def drag(num_buckets: int, num_regions: int) -> DragResult:
    """Drag buckets, spread over the rows, through one soil or regions; check the volume."""
    soil: Soil | SplitSoil
    level = np.zeros(GRID.shape)
    if num_regions == 1:
        soil = Soil(GRID, level, SOIL)
    else:
        soil = SplitSoil(GRID, level, SOIL, num_regions=num_regions, halo=HALO)
    seconds: dict[str, float] = {}
    add_timer(soil, "step", "all", seconds)
    for region in soil.regions if isinstance(soil, SplitSoil) else ():
        add_timer(region, "step", f"rows from {region.slab.first}", seconds)
    start, excavated = soil.total_mm3, 0
    for tick, sweeps in enumerate(drag_sweeps(num_buckets)):
        step = soil.step(tick, sweeps, NO_DEPOSIT_REQUESTS)
        excavated += int(step.conversions["volume_mm3"].sum(dtype=np.int64))
        if soil.total_mm3 + excavated != start:
            raise SystemExit(f"tick {tick}: {soil.total_mm3 + excavated - start} mm^3 too much")
    of_all = seconds.pop("all")
    of_slowest = max(seconds.values(), default=of_all)
    to_ms = 1e3 / DRAG_TICKS
    heights = soil.columns.height.copy()
    return DragResult(to_ms * of_all, to_ms * of_slowest, 1e-9 * excavated, heights)


def drag_sweeps(num_buckets: int) -> list[Rows]:
    """Return the SWEEP rows of each tick: buckets dragged 6 m, in the middle of equal parts."""
    starts = GRID.x((np.arange(num_buckets) + 0.5) / num_buckets * GRID.rows) - 3.0
    x = 6.0 / DRAG_TICKS * np.arange(DRAG_TICKS + 1)
    ticks = []
    for before, after in pairwise(x.tolist()):
        parts = []
        for number, start in enumerate(starts.tolist()):
            rows = bucket_sweep((start + before, 0.0, -0.3), (start + after, 0.0, -0.3))
            rows["room_mm3"], rows["machine_id"] = ROOM, number + 1
            parts.append(rows)
        ticks.append(join_rows(parts, SWEEP))
    return ticks


if __name__ == "__main__":
    main()
