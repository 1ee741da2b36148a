"""What the soil costs beside the reference's way: landings, a collapse, a scoop, growing maps.

    python benchmarks/soil_step_cost.py              # all of it: about a minute
    python benchmarks/soil_step_cost.py --runs 1     # quicker, less sure

Ours is `Soil.step`, all of it: judging rows, cutting, landing, slip, the rows of what changed and
the tiles' account, with default parameters. The baseline is `reference_soil.py`. Both are measured
in turn in the same run; the table has the medians of the runs, in ms where nothing else is said,
and how many times the baseline costs ours. One core. Before a time counts, it is checked that both
hold the soil they were given and stand no steeper than allowed.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from reference_soil import ReferenceSoil

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, Rows, empty_rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.warm_up import warm_up

PARAMS = SoilParams()
NO_SWEEPS, NO_DEPOSIT_REQUESTS = empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST)

PROFILE = ((0, 0), (-0.4, 0), (-0.7, 0.1), (-0.9, 0.3), (-1, 0.5), (-1, 0.8), (-0.9, 1.0))
"""(x, z) of the bucket's seven key points behind and above its lip [m]."""

WIDTH = 1.2  # of the bucket [m]
DEPTH = 0.3  # it digs [m]
DISTANCE_PER_TICK = 0.01  # it moves in a tick [m]

LANDING_TICKS = 200
LANDED_M3 = 0.01
COUNTS = ((1, ""), (50, ""), (250, "<= 0.25"))
SCOOPS = ((161, 0.05, "<= 0.2"), (321, 0.025, "<= 0.5"))
SIZES = (129, 257, 513, 1025, 2049)
MAX_TICKS = 100_000
BASELINE_TIME = 0.5
"""Wall time [s] after which the baseline has dug enough ticks of a stroke, on large maps."""

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Line:
    """A line of the table in one run: what was measured, ours, the baseline's, what is wanted."""

    name: str
    ours: float
    baseline: float | None
    target: str = ""
    compare: bool = True  # how many times the baseline's is ours


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=3, help="of each; medians are printed")
    runs = parser.parse_args().runs
    compile_all()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before; median of {runs} runs")
    print(f"{'ms where not said':<44}{'ours':>10}{'baseline':>11}{'ratio':>9}  target")
    scenes: list[Callable[[], list[Line]]] = [
        *(partial(landings, *count) for count in COUNTS),
        collapse,
        *(partial(scoop_through, *scoop) for scoop in SCOOPS),
        growing_maps,
    ]
    for scene in scenes:
        for lines in zip(*(scene() for _ in range(runs)), strict=True):
            print_median(lines)


def print_median(lines: tuple[Line, ...]) -> None:
    """One line of the table from that line of every run."""
    ours = statistics.median(line.ours for line in lines)
    others = [line.baseline for line in lines if line.baseline is not None]
    baseline = ratio = ""
    if others:
        baseline = format_value(statistics.median(others))
    if others and lines[0].compare:
        times = (other / line.ours for other, line in zip(others, lines, strict=True))
        ratio = f"{format_value(statistics.median(times))} x"
    print(
        (
            f"{lines[0].name:<44}{format_value(ours):>10}{baseline:>11}{ratio:>9}"
            f"  {lines[0].target}"
        ).rstrip(),
        flush=True,
    )


def format_value(value: float) -> str:
    """A number with as many places as it is worth."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def compile_all() -> None:
    """Compile every kernel before the first measurement."""
    warm_up(PARAMS)
    grid = Grid(17, 17, 0.2)
    other = baseline_soil(grid, np.zeros(grid.shape))
    other.deposit(np.zeros(1), np.zeros(1), np.ones(1))
    other.dig(*ends_of_bucket((0.0, 0.0, -0.1)))
    other.collapse()
    other.max_slope_excess()


def baseline_soil(grid: Grid, heights: NDArray[np.float64]) -> ReferenceSoil:
    """The baseline with the parameters of our soil."""
    return ReferenceSoil(
        grid,
        heights,
        angle=math.radians(PARAMS.repose_angle),
        radius=PARAMS.relaxation_radius,
        tolerance=PARAMS.relaxation_tolerance,
    )


def landings(count: int, target: str) -> list[Line]:
    """`count` pieces land on one spot in each tick of 5 ms, for a second, then all comes to rest.

    Our soil may defer some relaxation to later ticks; the time of these is reported as well.
    """
    grid = Grid(257, 257, 0.4)
    soil = Soil(grid, np.zeros(grid.shape), PARAMS)
    other = baseline_soil(grid, np.zeros(grid.shape))
    rows = empty_rows(DEPOSIT_REQUEST, count)
    rows["x"], rows["y"], rows["machine_id"] = 0.07, 0.11, 1
    rows["volume_mm3"], rows["particle_id"] = round(LANDED_M3 * 1e9), np.arange(1, count + 1)
    x, y, volume = np.full(count, 0.07), np.full(count, 0.11), np.full(count, LANDED_M3)

    before = soil.total_mm3
    ours = [measure_time(lambda: soil.step(tick, NO_SWEEPS, rows)) for tick in range(LANDING_TICKS)]  # noqa: B023
    left = list(step_until_at_rest(soil))
    baseline = [measure_time(lambda: other.deposit(x, y, volume)) for _ in range(LANDING_TICKS)]
    landed = LANDING_TICKS * count * LANDED_M3
    check("landings", soil, other, (soil.total_mm3 - before) / 1e9, landed, other.volume)
    name = f"{count} landing{'s' * (count > 1)} a tick of 5 ms"
    each = 1e3 / (LANDING_TICKS * count)
    return [
        Line(name + ", median", statistics.median(ours), statistics.median(baseline), target),
        Line("  p99", p99(ours), p99(baseline)),
        Line("  us a landing until all rest", each * sum(ours + left), each * sum(baseline)),
    ]


def collapse() -> list[Line]:
    """The walls of a trench, dug in one go into 513 x 513 columns of 0.2 m, come down."""
    grid = Grid(513, 513, 0.2)
    x, y = np.abs(grid.x(np.arange(513))), np.abs(grid.y(np.arange(513)))
    heights = np.where((x[:, None] < 10.0) & (y < 2.0), -2.0, 0.0)
    soil = Soil(grid, heights, PARAMS)
    other = baseline_soil(grid, heights)
    before, dug = soil.total_mm3, other.volume

    was_dug = np.flatnonzero(heights < 0.0)  # as a cut notes it
    noted = measure_time(lambda: soil.relaxation.mark_disturbed(was_dug, include_neighbours=True))
    ours = list(step_until_at_rest(soil))
    passes: list[int] = []
    baseline = measure_time(lambda: passes.append(other.collapse()))
    check("collapse", soil, other, dug + (soil.total_mm3 - before) / 1e9, dug, other.volume)
    name = "walls of a 20 x 4 x 2 m trench, 513^2"
    return [
        Line(name, noted + sum(ours), baseline, "<= 5"),
        Line("  of it noting what was dug", noted, None),
        Line("  ticks; the baseline's passes over the map", len(ours), passes[0], compare=False),
        Line("  worst tick", max(ours), baseline),
    ]


def scoop_through(size: int, cell: float, target: str) -> list[Line]:
    """A bucket goes in, 1.5 m through the soil and out, 10 mm a tick, on a map of 8 m."""
    grid = Grid(size, size, cell)
    path = scoop_path()
    ours = digging(grid, path)
    baseline = baseline_digging(grid, path, math.inf)
    return [
        Line(f"scoop through {size}^2, a tick, median", *medians(ours, baseline), target),
        Line("  p99", p99(ours), p99(baseline)),
    ]


def growing_maps() -> list[Line]:
    """A bucket is dragged 3 m, 10 mm a tick, on maps of ever more columns of 0.2 m."""
    path: list[Point] = [(-1.5 + DISTANCE_PER_TICK * tick, 0.0, -DEPTH) for tick in range(301)]
    lines = []
    for size in SIZES:
        grid = Grid(size, size, 0.2)
        ours, baseline = digging(grid, path), baseline_digging(grid, path, BASELINE_TIME)
        lines.append(Line(f"one bucket digs in {size}^2, a tick", *medians(ours, baseline)))
    first, last = lines[0], lines[-1]
    assert first.baseline is not None
    assert last.baseline is not None
    growth = Line(
        f"  {SIZES[-1]}^2 over {SIZES[0]}^2 [times]",
        last.ours / first.ours,
        last.baseline / first.baseline,
        "<= 1.5",
        compare=False,
    )
    return [*lines, growth]


def digging(grid: Grid, path: list[Point]) -> list[float]:
    """Wall time [ms] of each tick of our soil, the bucket's lip moving along `path`."""
    soil = Soil(grid, np.zeros(grid.shape), PARAMS)
    before, taken, times = soil.total_mm3, 0, []
    for tick, (start, end) in enumerate(pairwise(path)):
        rows = sweep_rows(start, end)
        begin = time.perf_counter()
        step = soil.step(tick, rows, NO_DEPOSIT_REQUESTS)
        times.append(1e3 * (time.perf_counter() - begin))
        taken += int(step.conversions["volume_mm3"].sum(dtype=np.int64))
    if taken <= 0 or before - soil.total_mm3 != taken:
        raise SystemExit(f"the scoop took {taken} mm^3 and the soil lost another amount")
    return times


def baseline_digging(grid: Grid, path: list[Point], max_time: float) -> list[float]:
    """The same [ms] of the baseline; ends after 5 ticks or more when `longest` s are over."""
    soil = baseline_soil(grid, np.zeros(grid.shape))
    dug, times = 0.0, []
    for end in path[1:]:
        ends = ends_of_bucket(end)
        begin = time.perf_counter()
        dug += soil.dig(*ends)
        soil.collapse()
        times.append(1e3 * (time.perf_counter() - begin))
        if len(times) >= 5 and sum(times) > 1e3 * max_time:
            break
    if dug <= 0.0 or not math.isclose(-soil.volume, dug, rel_tol=1e-6):
        raise SystemExit(f"the baseline dug {dug} m^3 and lost another amount")
    return times


def scoop_path() -> list[Point]:
    """The lip's places: down into the soil, along, up and out."""
    down = np.arange(0.02, -DEPTH, -DISTANCE_PER_TICK)
    along = np.arange(-0.5, 1.0, DISTANCE_PER_TICK)
    up = np.arange(-DEPTH, 0.3, DISTANCE_PER_TICK)
    places = [(-0.5, 0.0, z) for z in down]
    places += [(x, 0.0, -DEPTH) for x in along]
    return places + [(1.0, 0.0, z) for z in up]


def sweep_rows(start: Point, end: Point) -> Rows:
    """SWEEP rows of the bucket whose lip's middle moves from `start` to `end` (x, y, z) [m]."""
    rows = empty_rows(SWEEP, 2 * len(PROFILE))
    rows["machine_id"], rows["pair"] = 1, np.repeat(np.arange(len(PROFILE)), 2)
    ends = np.stack([ends_of_bucket(start), ends_of_bucket(end)])  # (tick's end, side, pair, xyz)
    for moment in (0, 1):
        for axis in range(3):
            rows[f"{'xyz'[axis]}{moment}"] = ends[moment, :, :, axis].T.reshape(-1)
    return rows


def ends_of_bucket(lip: Point) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Left and right key points (x, y, z) [m] of the bucket, shape (pairs, 3)."""
    profile = np.array(PROFILE, dtype=np.float64)
    middle = np.array(lip) + np.stack([profile[:, 0], 0.0 * profile[:, 0], profile[:, 1]], axis=1)
    half = np.array([0.0, 0.5 * WIDTH, 0.0])
    return middle + half, middle - half


def step_until_at_rest(soil: Soil) -> Iterator[float]:
    """Wall time [ms] of each tick in which nothing happens but slip, until none waits."""
    for tick in range(MAX_TICKS):
        if not soil.relaxation.num_pending:
            return
        yield measure_time(lambda: soil.step(tick, NO_SWEEPS, NO_DEPOSIT_REQUESTS))  # noqa: B023
    raise SystemExit(f"the soil has not come to rest in {MAX_TICKS} ticks")


def check(
    what: str, soil: Soil, other: ReferenceSoil, ours: float, given: float, theirs: float
) -> None:
    """Both hold the volume they were given [m^3], and neither stands too steep."""
    if not (math.isclose(ours, given, rel_tol=1e-9) and math.isclose(theirs, given, rel_tol=1e-6)):
        raise SystemExit(f"{what}: given {given} m^3; ours holds {ours}, the baseline {theirs}")
    allowed = PARAMS.relaxation_tolerance * other.grid.cell + 1e-6
    left = baseline_soil(other.grid, soil.columns.height).max_slope_excess()
    if max(left, other.max_slope_excess()) > allowed:
        raise SystemExit(
            f"{what}: too steep by {left:.4f} m (ours), {other.max_slope_excess():.4f} m"
            f" (baseline);"
            f" allowed are {allowed:.4f} m"
        )


def measure_time(work: Callable[[], object]) -> float:
    """Wall time [ms]."""
    start = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - start)


def medians(ours: list[float], baseline: list[float]) -> tuple[float, float]:
    """Of the ticks."""
    return statistics.median(ours), statistics.median(baseline)


def p99(times: list[float]) -> float:
    """What one tick of a hundred exceeds."""
    return float(np.percentile(times, 99))


if __name__ == "__main__":
    main()
