"""Measure a 5 ms step of N particles: falling to a heap, settled, asleep, in a moving bucket.

    python -m benchmarks.particle_step_cost        # about ten minutes
    python -m benchmarks.particle_step_cost --counts 1000 --peers

Prints the wall time per step, and per particle and step; `--chart FILE` draws it. A fall is timed
as a whole, and small numbers of particles fall several times; where all steps are alike the median
step is taken. The same block is measured as cubes in pybullet (the method of 2014) and, where it
is installed, as spheres in LIGGGHTS, up to a number of particles that each can handle. `--peers`
selects these peers, by default both; without a name it selects none. One core is used, or
`--threads` for this project's particles.

`liggghts_comparison` compares with LIGGGHTS in detail, `cubes_in_box` with cubes in a box;
`particle_feature_cost` measures the cost of each feature.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from benchmarks.liggghts_comparison import as_spheres, run_liggghts
from benchmarks.liggghts_runner import INSTALL_HINT, LiggghtsError, is_installed
from benchmarks.particle_scenes import (
    FALLING_STEPS,
    STEP,
    Engine,
    add_block,
    flat_ground,
    settle_steps,
    step_untimed,
    time_bucket,
    time_steps,
)
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from earthmoving_sim.pictures.style import (
    DPI,
    GREY,
    INK,
    LABEL,
    SMALL,
    add_axes,
    new_figure,
)
from machine_sim.dem import ParticleEngine, ParticleParams, warm_up
from machine_sim.dem.sleep import AWAKE
from machine_sim.reference_cubes import CubeEngine

COUNTS = (100, 200, 400, 1000, 5000, 10_000, 20_000, 40_000, 100_000)
KINDS = ("falling", "settled", "asleep", "moving bucket")
PEER_KINDS = ("falling", "settled")

PEERS = {"LIGGGHTS": 40_000, "cubes": 1000}
"""Maximum number of particles of each peer, by its run time."""

MIN_PARTICLES_TIMED = 1000
"""Total number of particles over all falls; a smaller block falls several times."""
MAX_FALLS = 5
MIN_ASLEEP_FRACTION = 0.99
"""Fraction of particles that must sleep in the scene "asleep"."""

_SLEEP_CHECK_STEPS, _MAX_SLEEP_CHECKS = 250, 8
"""Steps between checks whether a heap is asleep, and maximum number of checks."""

LABELS = {
    "particles": "particles",
    "LIGGGHTS": "spheres in LIGGGHTS",
    "cubes": "cubes in pybullet",
}
COLOURS = {"particles": "#0072b2", "LIGGGHTS": "#d55e00", "cubes": "#009e73"}
STYLES: dict[str, Literal["-", "--", ":", "-."]] = {
    "falling": "-",
    "settled": "--",
    "asleep": ":",
    "moving bucket": "-.",
}


def make_particles(**params: float) -> ParticleEngine:
    """Return an engine with a capacity for all counts."""
    return ParticleEngine(ParticleParams.from_mapping({"capacity": 10**6, **params}), flat_ground())


def time_heap(engine: Engine, count: int) -> tuple[float, float]:
    """Return the wall time of a step [ms] of a block that falls to a heap: falling, settled."""
    add_block(engine, count)
    falling = time_steps(engine, FALLING_STEPS, group=FALLING_STEPS)
    step_untimed(engine, settle_steps(count))
    return falling, time_steps(engine, 30)


def time_asleep(awake: ParticleEngine, threads: int) -> float:
    """Return the wall time of a step [ms] of a settled heap after it has fallen asleep.

    Raises:
        SystemExit: fewer than `MIN_ASLEEP_FRACTION` of the particles sleep.
    """
    engine = make_particles(sleep_speed=0.05, threads=threads)
    positions = awake.positions
    engine.add(positions, np.zeros_like(positions), awake.volumes_mm3, grow=False)
    for _ in range(_MAX_SLEEP_CHECKS):
        step_untimed(engine, _SLEEP_CHECK_STEPS)
        asleep_fraction = float((engine.sleep_states != AWAKE).mean())
        if asleep_fraction >= MIN_ASLEEP_FRACTION:
            return time_steps(engine, 60)
    raise SystemExit(f"only {100 * asleep_fraction:.0f} % of {engine.count} particles fell asleep")


def run_particle_engine(count: int, threads: int) -> list[float]:
    """Return the wall time of a step [ms] for each of `KINDS`."""
    engine = make_particles(allow_sleeping=False, threads=threads)
    falling, settled = time_heap(engine, count)
    # Without load locking the bucket's motion keeps its particles awake.
    bucket = time_bucket(make_particles(allow_load_locking=False, threads=threads), count)
    return [falling, settled, time_asleep(engine, threads), bucket]


def run_peer(name: str, count: int) -> list[float]:
    """Return times of `PEER_KINDS` [ms per step]; nan above the peer's maximum, or on failure."""
    if count > PEERS[name]:
        return [math.nan, math.nan]
    if name == "LIGGGHTS":
        block = make_particles()
        add_block(block, count)
        try:
            falling, settled, _ = run_liggghts(as_spheres(block))
        except LiggghtsError as error:
            print(error)
            return [math.nan, math.nan]
        return [1e-3 * count * falling, 1e-3 * count * settled]
    engine = CubeEngine(ParticleParams(), flat_ground())
    try:
        return list(time_heap(engine, count))
    finally:
        engine.close()


def measure_row(count: int, peers: list[str], threads: int) -> list[float]:
    """Return a row of the table [ms per step]: medians over interleaved falls."""
    num_falls = min(math.ceil(MIN_PARTICLES_TIMED / count), MAX_FALLS)
    rows = [
        [
            *run_particle_engine(count, threads),
            *(t for name in peers for t in run_peer(name, count)),
        ]
        for _ in range(num_falls)
    ]
    return [float(t) for t in np.median(rows, axis=0)]


def draw_chart(counts: list[int], times: NDArray[np.float64], names: list[str], path: Path) -> None:
    """Draw the time per step against the number of particles, with the line of real time.

    Args:
        counts: numbers of particles.
        times: wall times of a step [ms], shape (counts, names).
        names: program and kind of each column of `times`.
        path: file to write.
    """
    figure = new_figure(8.2, 5.0)
    axes = add_axes(figure, 0.7, 0.55, 5.4, 4.2)
    axes.axhline(1e3 * STEP, color=GREY, linewidth=0.8)
    axes.text(counts[0], 1.08e3 * STEP, "real time", size=SMALL, color=GREY, va="bottom")
    for column, name in zip(times.T, names, strict=True):
        program, kind = name.split(" ", 1)
        axes.loglog(counts, column, STYLES[kind], color=COLOURS[program], marker="o", markersize=3)
    axes.set_xlabel("particles", size=LABEL, color=INK)
    axes.set_ylabel("ms per 5 ms step, one core", size=LABEL, color=INK)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25, linewidth=0.5)
    kinds = [kind for kind in STYLES if any(name.endswith(kind) for name in names)]
    programs = [key for key in COLOURS if any(name.startswith(key) for name in names)]
    keys = [
        *(Line2D([], [], color=COLOURS[key], label=LABELS[key], linewidth=3) for key in programs),
        *(Line2D([], [], color=INK, linestyle=STYLES[kind], label=kind) for kind in kinds),
    ]
    axes.legend(
        keys,
        [str(key.get_label()) for key in keys],
        loc="upper left",
        bbox_to_anchor=(1.0, 1.0),
        frameon=False,
        fontsize=SMALL,
    )
    figure.savefig(path, dpi=DPI)


def main() -> None:
    """Measure and print the table."""
    parser = make_parser(__doc__)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="particle numbers")
    parser.add_argument(
        "--peers",
        choices=PEERS,
        nargs="*",
        help="programs to compare with; without a name: none; default: all that are installed",
    )
    parser.add_argument("--threads", type=int, default=1, help="threads of this project's engine")
    parser.add_argument("--chart", type=Path, help="file to draw ms per step against N into")
    options = parser.parse_args()
    peers = list(PEERS) if options.peers is None else list(options.peers)
    names = [f"particles {kind}" for kind in KINDS]
    is_missing = "LIGGGHTS" in peers and not is_installed()
    if is_missing:
        peers.remove("LIGGGHTS")
    names += [f"{name} {kind}" for name in peers for kind in PEER_KINDS]
    columns = [Column(name.removeprefix("particles ")) for name in names]
    table = ResultTable(columns, as_json=options.json, row_width=8, width=19)
    if is_missing:
        table.print_note(INSTALL_HINT if options.peers else "without LIGGGHTS: not installed")
    table.print_note(f"{describe_load()}; ms per 5 ms step (us per particle)")
    warm_up(ParticleParams(threads=options.threads))
    measure_row(20, peers, options.threads)
    table.print_header("N")
    rows = []
    for count in options.counts:
        rows.append(measure_row(count, peers, options.threads))
        texts = ["" if math.isnan(t) else f"{t:.3f} ({1e3 * t / count:.3f})" for t in rows[-1]]
        table.print_row(f"{count}", rows[-1], texts=texts)
    if options.chart:
        draw_chart(list(options.counts), np.array(rows), names, options.chart)


if __name__ == "__main__":
    main()
