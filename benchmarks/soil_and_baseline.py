"""Run this project's soil and the baseline on the same input, and check the results of both."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.bucket_sweeps import (
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    Point,
    bucket_ends,
    bucket_sweep,
)
from benchmarks.reference_soil import ReferenceSoil
from benchmarks.timing import elapsed_ms
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil, SoilStepResult
from soil_sim.soils.params import SoilParams

BucketEnds = tuple[NDArray[np.float64], NDArray[np.float64]]

PARAMS = SoilParams(repose_angle=30.0, swell=0.0)
DIG_DEPTH = 0.3
"""Depth of the bucket's lip under the ground [m]."""
DISTANCE_PER_TICK = 0.01
"""Motion of the bucket in a tick [m]."""
MAX_TICKS = 100_000
"""Ticks after which soil that is not at rest is an error."""
MIN_BASELINE_TICKS = 5


def make_baseline(grid: Grid, heights: NDArray[np.float64]) -> ReferenceSoil:
    """Return the baseline with the parameters of this project's soil."""
    return ReferenceSoil(
        grid,
        heights,
        angle=math.radians(PARAMS.repose_angle),
        radius=PARAMS.relaxation_radius,
        tolerance=PARAMS.relaxation_tolerance,
    )


def time_digging(grid: Grid, path: list[Point]) -> list[float]:
    """Return the wall time of each tick [ms] while the bucket's lip moves along `path`."""
    soil = Soil(grid, np.zeros(grid.shape), PARAMS)
    before, excavated, times = soil.total_mm3, 0, []
    for tick, (start, end) in enumerate(pairwise(path)):
        rows = bucket_sweep(start, end)
        steps: list[SoilStepResult] = []
        times.append(
            elapsed_ms(lambda: steps.append(soil.step(tick, rows, NO_DEPOSIT_REQUESTS)))  # noqa: B023
        )
        excavated += int(steps[0].conversions["volume_mm3"].sum(dtype=np.int64))
    if excavated <= 0 or before - soil.total_mm3 != excavated:
        raise SystemExit(
            f"scoop: {excavated} mm^3 in the conversion rows,"
            f" {before - soil.total_mm3} mm^3 less in the soil"
        )
    return times


def time_baseline_digging(grid: Grid, path: list[Point], max_time: float = math.inf) -> list[float]:
    """Return the wall time of each tick [ms] of the baseline.

    Args:
        grid: the map.
        path: positions of the bucket's lip, one for each end of a tick.
        max_time: total wall time [ms] after which the digging stops.
    """
    soil = make_baseline(grid, np.zeros(grid.shape))
    volumes: list[float] = []
    times: list[float] = []
    for lip in path[1:]:
        ends = bucket_ends(lip)

        def dig_and_collapse(ends: BucketEnds = ends) -> None:
            volumes.append(soil.dig(*ends))
            soil.collapse()

        times.append(elapsed_ms(dig_and_collapse))
        if len(times) >= MIN_BASELINE_TICKS and sum(times) > max_time:
            break
    excavated = sum(volumes)
    if excavated <= 0.0 or not math.isclose(-soil.volume, excavated, rel_tol=1e-6):
        raise SystemExit(f"scoop: baseline excavated {excavated} m^3 and holds {soil.volume} m^3")
    return times


def scoop_path() -> list[Point]:
    """Return positions of the lip [m]: down into the soil, along, up and out."""
    down = np.arange(0.02, -DIG_DEPTH, -DISTANCE_PER_TICK)
    along = np.arange(-0.5, 1.0, DISTANCE_PER_TICK)
    up = np.arange(-DIG_DEPTH, 0.3, DISTANCE_PER_TICK)
    path = [(-0.5, 0.0, z) for z in down]
    path += [(x, 0.0, -DIG_DEPTH) for x in along]
    return path + [(1.0, 0.0, z) for z in up]


def step_until_at_rest(soil: Soil) -> Iterator[float]:
    """Yield the wall time of each tick [ms] until no cell waits for relaxation."""
    for tick in range(MAX_TICKS):
        if not soil.relaxation.num_pending:
            return
        yield elapsed_ms(partial(soil.step, tick, NO_SWEEPS, NO_DEPOSIT_REQUESTS))
    raise SystemExit(f"the soil is not at rest after {MAX_TICKS} ticks")


def check_volumes(scene: str, expected: float, soil: float, baseline: float) -> None:
    """Exit if a soil does not hold the expected volume [m^3]."""
    if not (
        math.isclose(soil, expected, rel_tol=1e-9)
        and math.isclose(baseline, expected, rel_tol=1e-6)
    ):
        raise SystemExit(
            f"{scene}: expected {expected} m^3, soil has {soil}, baseline has {baseline}"
        )


def check_slopes(scene: str, soil: Soil, baseline: ReferenceSoil) -> None:
    """Exit if a slope is steeper than the relaxation tolerance allows."""
    allowed = PARAMS.relaxation_tolerance * baseline.grid.cell + 1e-6
    soil_excess = make_baseline(baseline.grid, soil.columns.height).max_slope_excess()
    baseline_excess = baseline.max_slope_excess()
    if max(soil_excess, baseline_excess) > allowed:
        raise SystemExit(
            f"{scene}: slopes too steep by {soil_excess:.4f} m (soil) and"
            f" {baseline_excess:.4f} m (baseline); allowed: {allowed:.4f} m"
        )
