"""What a 5 ms step of N particles costs: falling to a heap, settled, asleep, in a moving bucket.

Prints a table of wall time per step, and `--chart FILE` draws it. A fall is timed as a whole; where
all steps are alike it is the median step; few particles fall several times. Beside it stand the
same block as cubes in pybullet (the 2014 way of working), as many as can be waited for, and as
spheres in LIGGGHTS where that is installed; `--peers` chooses, and without a name leaves them out.
One core, or for our own particles `--threads`. Run from the repository root:
`python benchmarks/particle_step_cost.py`; takes about ten minutes.

`liggghts.py` looks closer at LIGGGHTS, `cubes.py` at cubes in a box, `particle_features.py` at what
sizes that vary, soil that sticks, growth and sleep cost.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Literal

import liggghts_comparison
import numpy as np
from liggghts_runner import MISSING, LiggghtsError, installed
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray
from particle_scenes import (
    FALLING,
    STEP,
    Engine,
    add_block,
    describe_load,
    flat_ground,
    run,
    settle_steps,
    time_bucket,
    time_steps,
)

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
PEERS = {"LIGGGHTS": 40_000, "cubes": 1000}
"""Peers measured beside ours, and the largest number of particles that is feasible for each."""
MIN_PARTICLES_TIMED = 1000
"""Particles that need to fall once only."""
MAX_FALLS = 5
MIN_ASLEEP_FRACTION = 0.99
"""Share of particles that rest where all are said to."""

_MAX_SLEEP_WAITS = 8
"""Times 250 steps that a heap may take to fall asleep."""
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


def particles(**params: float) -> ParticleEngine:
    """An engine with room for all."""
    return ParticleEngine(ParticleParams.from_mapping({"capacity": 10**6, **params}), flat_ground())


def time_heap(engine: Engine, count: int) -> tuple[float, float]:
    """A block that falls to a heap [ms a step]: falling, settled."""
    add_block(engine, count)
    falling = time_steps(engine, FALLING, group=FALLING)
    run(engine, settle_steps(count))
    return falling, time_steps(engine, 30)


def run_particle_engine(count: int, threads: int) -> list[float]:
    """All of `KINDS` [ms a step], on some cores."""
    engine = particles(allow_sleeping=False, threads=threads)
    falling, settled = time_heap(engine, count)
    calm = particles(sleep_speed=0.05, threads=threads)
    place = engine.positions
    calm.add(place, np.zeros_like(place), engine.volumes_mm3, grow=False)
    resting = 0.0
    for _ in range(_MAX_SLEEP_WAITS):
        run(calm, 250)
        resting = float((calm.sleep_states != AWAKE).mean())
        if resting >= MIN_ASLEEP_FRACTION:
            break
    asleep = time_steps(calm, 60)
    assert resting >= MIN_ASLEEP_FRACTION, (
        f"{100 * resting:.0f} % of {count} are asleep, which is no such scene"
    )
    # Shaken enough to stay awake, unless it rides as one body.
    return [
        falling,
        settled,
        asleep,
        time_bucket(particles(allow_load_locking=False, threads=threads), count),
    ]


def run_peer(name: str, count: int) -> list[float]:
    """Falling and settled [ms a step]; nan for more than `PEERS` has, or a failure."""
    if count > PEERS[name]:
        return [math.nan, math.nan]
    if name == "LIGGGHTS":
        block = particles()
        add_block(block, count)
        try:
            falling, settled, _ = liggghts_comparison.run_liggghts(
                liggghts_comparison.as_spheres(block)
            )
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
    """A row of the table [ms a step]: medians over falls that take turns."""
    falls = min(math.ceil(MIN_PARTICLES_TIMED / count), MAX_FALLS)
    rows = [
        [
            *run_particle_engine(count, threads),
            *(t for name in peers for t in run_peer(name, count)),
        ]
        for _ in range(falls)
    ]
    return [float(t) for t in np.median(rows, axis=0)]


def draw(counts: list[int], times: NDArray[np.float64], names: list[str], path: Path) -> None:
    """Chart of ms per step against N, with the line of real time."""
    figure = new_figure(8.2, 5.0)
    axes = add_axes(figure, 0.7, 0.55, 5.4, 4.2)
    axes.axhline(1e3 * STEP, color=GREY, linewidth=0.8)
    axes.text(counts[0], 1.08e3 * STEP, "real time", size=SMALL, color=GREY, va="bottom")
    for column, name in zip(times.T, names, strict=True):
        who, kind = name.split(" ", 1)
        axes.loglog(counts, column, STYLES[kind], color=COLOURS[who], marker="o", markersize=3)
    axes.set_xlabel("particles", size=LABEL, color=INK)
    axes.set_ylabel("ms per 5 ms step, one core", size=LABEL, color=INK)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25, linewidth=0.5)
    kinds = [kind for kind in STYLES if any(name.endswith(kind) for name in names)]
    shown = [who for who in COLOURS if any(name.startswith(who) for name in names)]
    keys = [
        *(Line2D([], [], color=COLOURS[who], label=LABELS[who], linewidth=3) for who in shown),
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
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    options.add_argument("--peers", choices=PEERS, nargs="*", default=tuple(PEERS))
    options.add_argument("--threads", type=int, default=1, help="cores that our particles may use")
    options.add_argument("--chart", type=Path, help="draw ms per step against N into this file")
    given = options.parse_args()
    peers = list(given.peers)
    if "LIGGGHTS" in peers and not installed():
        print(f"{MISSING}\n")
        peers.remove("LIGGGHTS")
    print(describe_load())
    warm_up(ParticleParams(threads=given.threads))
    measure_row(20, peers, given.threads)
    names = [f"particles {kind}" for kind in KINDS]
    names += [f"{name} {kind}" for name in peers for kind in KINDS[:2]]
    print("ms per 5 ms step (us per particle)")
    print(f"{'N':>7}" + "".join(f"{name.removeprefix('particles '):>19}" for name in names))
    rows = []
    for count in given.counts:
        rows.append(measure_row(count, peers, given.threads))
        cells = ("" if math.isnan(t) else f"{t:.3f} ({1e3 * t / count:.3f})" for t in rows[-1])
        print(f"{count:>7}" + "".join(f"{cell:>19}" for cell in cells), flush=True)
    if given.chart:
        draw(list(given.counts), np.array(rows), names, given.chart)


if __name__ == "__main__":
    main()
