"""Measure the soil step beside the method of 2014: deposits, a collapse, a scoop, growing maps.

    python -m benchmarks.soil_step_cost              # about a minute
    python -m benchmarks.soil_step_cost --runs 1     # faster, less precise

The complete `Soil.step` is timed with default parameters: validation of rows, cutting, deposition,
relaxation, conversion rows and tile checksums. The baseline is `benchmarks.reference_soil`. Both
are measured in turn in the same run on one core; the table has the medians of the runs and the
ratio of the baseline to this soil. Each scene checks that both soils hold the volume they were
given and have no slope steeper than allowed.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.bucket_sweeps import NO_SWEEPS, Point, bucket_ends
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from benchmarks.soil_and_baseline import (
    DIG_DEPTH,
    DISTANCE_PER_TICK,
    PARAMS,
    check_slopes,
    check_volumes,
    make_baseline,
    scoop_path,
    step_until_at_rest,
    time_baseline_digging,
    time_digging,
)
from benchmarks.timing import elapsed_ms, percentile_99
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, empty_rows
from soil_sim.soil import Soil
from soil_sim.warm_up import warm_up

NUM_DEPOSIT_TICKS = 200
DEPOSIT_VOLUME = 0.01
"""Volume of each deposit [m^3]."""
DEPOSITS = ((1, ""), (50, ""), (250, "<= 0.25"))
"""Number of deposits in a tick, and target of its median [ms]."""
SCOOPS = ((161, 0.05, "<= 0.2"), (321, 0.025, "<= 0.5"))
"""Rows and columns of the map, cell size [m], and target of the mean tick [ms]."""
SIZES = (129, 257, 513, 1025, 2049)
"""Rows and columns of the growing maps."""
MAX_BASELINE_TIME = 500.0
"""Wall time [ms] after which the baseline stops digging on large maps."""

COLUMNS = (Column("soil", spec=".3g"), Column("baseline", spec=".3g"), Column("ratio", "", ".3g"))


@dataclass(frozen=True)
class Line:
    """A row of the table in one run.

    Attributes:
        name: the measured quantity.
        soil: value of this project's soil.
        baseline: value of the baseline; None if it has none.
        target: target of the soil's value, as printed.
        unit: unit of both values.
        has_ratio: whether the ratio of the two values is printed.
    """

    name: str
    soil: float
    baseline: float | None
    target: str = ""
    unit: str = "ms"
    has_ratio: bool = True


def main() -> None:
    """Measure and print the table."""
    options = make_parser(__doc__, runs=3).parse_args()
    compile_all()
    table = ResultTable(COLUMNS, as_json=options.json, row_width=46)
    table.print_note(f"{describe_load()}; medians of {options.runs} runs")
    table.print_header("ms unless stated otherwise")
    scenes: list[Callable[[], list[Line]]] = [
        *(partial(measure_deposits, *case) for case in DEPOSITS),
        measure_collapse,
        *(partial(measure_scoop, *case) for case in SCOOPS),
        measure_growing_maps,
    ]
    for scene in scenes:
        for lines in zip(*(scene() for _ in range(options.runs)), strict=True):
            print_medians(table, lines)


def print_medians(table: ResultTable, lines: tuple[Line, ...]) -> None:
    """Print the medians over the runs of one row."""
    first = lines[0]
    soil = statistics.median(line.soil for line in lines)
    baseline = ratio = None
    if first.baseline is not None:
        values = [line.baseline for line in lines if line.baseline is not None]
        baseline = statistics.median(values)
        if first.has_ratio:
            ratio = statistics.median(a / b.soil for a, b in zip(values, lines, strict=True))
    remark = f"target {first.target}" if first.target else ""
    table.print_row(first.name, [soil, baseline, ratio], unit=first.unit, remark=remark)


def compile_all() -> None:
    """Compile every kernel before the first measurement."""
    warm_up(PARAMS)
    grid = Grid(17, 17, 0.2)
    baseline = make_baseline(grid, np.zeros(grid.shape))
    baseline.deposit(np.zeros(1), np.zeros(1), np.ones(1))
    baseline.dig(*bucket_ends((0.0, 0.0, -0.1)))
    baseline.collapse()
    baseline.max_slope_excess()


def measure_deposits(count: int, target: str) -> list[Line]:
    """Deposit `count` volumes at one position in each tick for a second, then wait for rest.

    The soil may defer relaxation to later ticks; the time of these is included per deposit.
    """
    grid = Grid(257, 257, 0.4)
    soil = Soil(grid, np.zeros(grid.shape), PARAMS)
    baseline = make_baseline(grid, np.zeros(grid.shape))
    rows = empty_rows(DEPOSIT_REQUEST, count)
    rows["x"], rows["y"], rows["machine_id"] = 0.07, 0.11, 1
    rows["volume_mm3"], rows["particle_id"] = round(DEPOSIT_VOLUME * 1e9), np.arange(1, count + 1)
    x, y, volume = np.full(count, 0.07), np.full(count, 0.11), np.full(count, DEPOSIT_VOLUME)

    before = soil.total_mm3
    ticks = range(NUM_DEPOSIT_TICKS)
    soil_times = [elapsed_ms(partial(soil.step, tick, NO_SWEEPS, rows)) for tick in ticks]
    rest_times = list(step_until_at_rest(soil))
    baseline_times = [elapsed_ms(partial(baseline.deposit, x, y, volume)) for _ in ticks]
    expected = NUM_DEPOSIT_TICKS * count * DEPOSIT_VOLUME
    check_volumes("deposits", expected, (soil.total_mm3 - before) / 1e9, baseline.volume)
    check_slopes("deposits", soil, baseline)
    name = f"{count} deposit{'s' * (count > 1)} in a tick"
    scale = 1e3 / (NUM_DEPOSIT_TICKS * count)
    medians = statistics.median(soil_times), statistics.median(baseline_times)
    return [
        Line(f"{name}, median", *medians, target),
        Line(f"{name}, p99", percentile_99(soil_times), percentile_99(baseline_times)),
        Line(
            f"{name}, us per deposit until rest",
            scale * sum(soil_times + rest_times),
            scale * sum(baseline_times),
            unit="us",
        ),
    ]


def measure_collapse() -> list[Line]:
    """Let the walls of a trench fail that was excavated at once, 513 x 513 columns of 0.2 m."""
    grid = Grid(513, 513, 0.2)
    x, y = np.abs(grid.x(np.arange(513))), np.abs(grid.y(np.arange(513)))
    heights = np.where((x[:, None] < 10.0) & (y < 2.0), -2.0, 0.0)
    soil = Soil(grid, heights, PARAMS)
    baseline = make_baseline(grid, heights)
    before, expected = soil.total_mm3, baseline.volume

    excavated = np.flatnonzero(heights < 0.0)
    marking = elapsed_ms(lambda: soil.relaxation.mark_disturbed(excavated, include_neighbours=True))
    soil_times = list(step_until_at_rest(soil))
    passes: list[int] = []
    baseline_time = elapsed_ms(lambda: passes.append(baseline.collapse()))
    check_volumes("collapse", expected, expected + (soil.total_mm3 - before) / 1e9, baseline.volume)
    check_slopes("collapse", soil, baseline)
    name = "collapse of a 20 x 4 x 2 m trench, 513^2"
    return [
        Line(name, marking + sum(soil_times), baseline_time, "<= 5"),
        Line("  marking the disturbed columns", marking, None),
        Line("  ticks; passes of the baseline", len(soil_times), passes[0], "", "", False),
        Line("  slowest tick of the collapse", max(soil_times), baseline_time),
    ]


def measure_scoop(size: int, cell: float, target: str) -> list[Line]:
    """Move a bucket into the soil, 1.5 m through it and out on a map of 8 m."""
    grid = Grid(size, size, cell)
    path = scoop_path()
    soil_times, baseline_times = time_digging(grid, path), time_baseline_digging(grid, path)
    name = f"scoop on {size}^2"
    medians = statistics.median(soil_times), statistics.median(baseline_times)
    means = statistics.fmean(soil_times), statistics.fmean(baseline_times)
    return [
        Line(f"{name}, median tick", *medians),
        Line(f"{name}, mean tick", *means, target),
        Line(f"{name}, p99", percentile_99(soil_times), percentile_99(baseline_times), "<= 2"),
    ]


def measure_growing_maps() -> list[Line]:
    """Drag a bucket 3 m through maps of growing size with columns of 0.2 m."""
    path: list[Point] = [(-1.5 + DISTANCE_PER_TICK * k, 0.0, -DIG_DEPTH) for k in range(301)]
    lines = []
    for size in SIZES:
        grid = Grid(size, size, 0.2)
        soil_time = statistics.median(time_digging(grid, path))
        baseline_time = statistics.median(time_baseline_digging(grid, path, MAX_BASELINE_TIME))
        lines.append(Line(f"digging in {size}^2, median tick", soil_time, baseline_time))
    first, last = lines[0], lines[-1]
    assert first.baseline is not None
    assert last.baseline is not None
    name = f"  {SIZES[-1]}^2 over {SIZES[0]}^2"
    growth = last.soil / first.soil, last.baseline / first.baseline
    return [*lines, Line(name, *growth, "<= 1.5", "", False)]


if __name__ == "__main__":
    main()
