"""Measure what several kinds of soil, uneven moisture and noise cost over one soil everywhere.

    python -m benchmarks.several_soils_cost              # about a minute
    python -m benchmarks.several_soils_cost --runs 1     # faster, less precise

Two scenes with large failures: the walls of a trench of 20 x 4 x 2 m fail, and 250 m^3 are dumped
at one point in a tick. Each is run to rest in turn on each ground; the table has the total time of
the ticks of the fastest run, and its ratio to that on one soil: other work on the computer delays
most runs by several milliseconds. The two kinds of soil, sand and gravel, meet in the middle of the
scene. The rows of several seeds of the noise have the mean and the maximum of the values of each.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.bucket_sweeps import NO_SWEEPS
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from benchmarks.soil_and_baseline import step_until_at_rest
from benchmarks.timing import elapsed_ms
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, empty_rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.warm_up import warm_up

GRID = Grid(513, 513, 0.2)
DUMP_VOLUME = 250.0
"""Volume that is dumped at once [m^3 bank]."""
NOISE = 3.0
"""Amplitude of the noise of the angle of repose [degrees]."""
NUM_SEEDS = 8
"""Seeds of the noise, from 1, besides the shipped one."""

COLUMNS = (
    Column("time", spec=".4g"),
    Column("slowest tick", spec=".3g"),
    Column("ticks", "", ".3g"),
    Column("over one soil", "", ".3g"),
)


class Ground(NamedTuple):
    """A terrain of dry sand, and what varies in it.

    Attributes:
        name: name of the row.
        params: parameters that differ from the shipped ones.
        soil, moisture: kind [id] and moisture [%] of each column; None: the same everywhere.
    """

    name: str
    params: Mapping[str, object]
    soil: NDArray[np.uint8] | None = None
    moisture: NDArray[np.uint8] | None = None


def main() -> None:
    """Measure and print the table."""
    options = make_parser(__doc__, runs=9).parse_args()
    warm_up(SoilParams())
    table = ResultTable(COLUMNS, as_json=options.json, row_width=34)
    table.print_note(f"{describe_load()}; fastest of {options.runs} runs")
    scenes: dict[str, Callable[[Ground], list[float]]] = {
        "trench": time_trench,
        "dump": time_dump,
    }
    for name, scene in scenes.items():
        table.print_header(f"{name}, total of the ticks")
        grounds, seeds = list_grounds(), list_noise_seeds()
        runs = [[scene(each) for each in grounds + seeds] for _ in range(options.runs)]
        rows = [summarize(runs, k) for k in range(len(grounds + seeds))]
        for ground, row in zip(grounds, rows, strict=False):
            table.print_row(f"{name}: {ground.name}", row)
        of_seeds = list(zip(*rows[len(grounds) :], strict=True))
        for label, combine in (("mean", statistics.mean), ("max", max)):
            title = f"{name}: noise, {label} of {NUM_SEEDS} seeds"
            table.print_row(title, [combine(values) for values in of_seeds])


def summarize(runs: list[list[list[float]]], k: int) -> list[float]:
    """Return the row of ground k, of its fastest run.

    Args:
        runs: wall time of each tick [ms], [run][ground][tick]; ground 0 has one soil.
        k: number of the ground.
    """
    times = min((run[k] for run in runs), key=sum)
    return [sum(times), max(times), len(times), sum(times) / min(sum(run[0]) for run in runs)]


def list_grounds() -> list[Ground]:
    """Return the grounds, one soil everywhere first."""
    shape, middle = GRID.shape, GRID.cols // 2
    kinds = np.zeros(shape, dtype=np.uint8)
    kinds[:, middle:] = 1
    across = np.zeros(shape, dtype=np.uint8)
    across[GRID.rows // 2 :] = 1
    moisture = np.random.default_rng(1).integers(0, 11, shape, dtype=np.uint8)
    two = {"additional_soils": ("gravel",)}
    return [
        Ground("one soil", {}),
        Ground("two soils, along", two, kinds),
        Ground("two soils, across", two, across),
        Ground("uneven moisture", {}, moisture=moisture),
        Ground("noise of the angle", {"repose_angle_noise": NOISE}),
    ]


def list_noise_seeds() -> list[Ground]:
    """Return grounds with the noise of `NUM_SEEDS` other seeds."""
    seeds = range(1, NUM_SEEDS + 1)
    return [Ground("", {"repose_angle_noise": NOISE, "noise_seed": seed}) for seed in seeds]


def make_soil(ground: Ground, heights: NDArray[np.float64]) -> Soil:
    """Return a ground with a surface [m]."""
    params = SoilParams(**{"soil": "dry sand", **ground.params})  # type: ignore[arg-type]
    return Soil(GRID, heights, params, soil=ground.soil, moisture=ground.moisture)


def time_trench(ground: Ground) -> list[float]:
    """Return the wall time of each tick [ms] until the walls of a trench are at rest."""
    x, y = np.abs(GRID.x(np.arange(GRID.cols))), np.abs(GRID.y(np.arange(GRID.rows)))
    heights = np.where((y[:, None] < 2.0) & (x < 10.0), -2.0, 0.0)
    soil = make_soil(ground, heights)
    before, excavated = soil.total_mm3, np.flatnonzero(heights < 0.0)
    marking = elapsed_ms(lambda: soil.relaxation.mark_disturbed(excavated, include_neighbours=True))
    times = [marking, *step_until_at_rest(soil)]
    check_volume(soil, before)
    return times


def time_dump(ground: Ground) -> list[float]:
    """Return the wall time of each tick [ms] until a volume dumped at one point is at rest."""
    soil = make_soil(ground, np.zeros(GRID.shape))
    volume = round(DUMP_VOLUME * 1e9)
    rows = empty_rows(DEPOSIT_REQUEST, 100)
    rows["x"], rows["y"], rows["machine_id"] = 0.07, 0.11, 1
    rows["volume_mm3"], rows["particle_id"] = volume // 100, np.arange(1, 101)
    before = soil.total_mm3
    times = [elapsed_ms(partial(soil.step, 0, NO_SWEEPS, rows)), *step_until_at_rest(soil)]
    check_volume(soil, before + volume)
    return times


def check_volume(soil: Soil, expected: int) -> None:
    """Exit if a soil does not hold a volume [mm^3], or has slopes that should fail."""
    excess = soil.relaxation.max_slope_excess()
    if soil.total_mm3 != expected or excess > 0.004:
        raise SystemExit(
            f"the soil holds {soil.total_mm3} mm^3, not {expected}, or has slopes that exceed"
            f" its angle of repose (by {excess} in the tangent)"
        )


if __name__ == "__main__":
    main()
