"""Compare a 5 ms step of soil as rigid cubes in pybullet with one of soil as particles.

    python -m benchmarks.cubes_in_box              # five runs

The same soil falls into the same open box and comes to rest: N rigid cubes with the constraints of
the 2014 reference (`machine_sim.reference_cubes`), and N particles that are kept awake, so that
both have contacts to solve. Particles with the shipped parameters, which fall asleep, are timed at
rest as well. The box does not move. Each time is the median over the runs of the median wall time
of a step; the engines run in turn.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.particle_scenes import (
    VOLUME,
    Engine,
    block_points,
    box_plates,
    flat_ground,
    step_untimed,
    time_steps,
)
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from benchmarks.timing import interleave
from machine_sim.dem import ParticleEngine, ParticleParams, Pose, warm_up
from machine_sim.reference_cubes import CubeEngine
from msg_bridge.contract.loose_soil import LooseSoil

COUNTS = (25, 50, 100, 200, 400)
RUNS = 5
SOIL = LooseSoil(swell=0.25)

TIMED_FALLING, UNTIMED, TIMED_RESTING = 100, 400, 100
"""Number of steps that are timed from the start, then not timed, then timed at rest."""

COLUMNS = (
    *(Column("cubes fall"), Column("particles fall"), Column("ratio", "")),
    *(Column("cubes rest"), Column("particles rest"), Column("ratio at rest", "")),
    Column("asleep"),
)


def make_cubes() -> Engine:
    """Return an engine of rigid cubes in pybullet."""
    return CubeEngine(ParticleParams(), flat_ground(), soils=[SOIL])


def make_awake_particles() -> Engine:
    """Return an engine of particles that never sleep."""
    return ParticleEngine(ParticleParams(allow_sleeping=False), flat_ground(), soils=[SOIL])


def make_default_particles() -> Engine:
    """Return an engine of particles with default parameters."""
    return ParticleEngine(ParticleParams(), flat_ground(), soils=[SOIL])


ENGINES = (make_cubes, make_awake_particles, make_default_particles)


def time_box(make_engine: Callable[[], Engine], count: int) -> tuple[float, float]:
    """Return the wall time of a step [ms] while soil falls into a box, and at rest."""
    engine = make_engine()
    edge = (VOLUME * 1e-9 * (1.0 + SOIL.swell)) ** (1 / 3)
    width = max(0.4, 1.1 * edge * (count / 0.6) ** (1 / 3))
    pose: Pose = (np.eye(3), np.array([0.0, 0.0, 0.5]))
    engine.add_tool(0, box_plates(width, 2.0 * width), pose, is_digging=False)
    points = block_points(count, 1.3 * edge, width - 1.5 * edge, 0.5 + edge)
    engine.add(points, np.zeros_like(points), VOLUME, grow=False)
    falling = time_steps(engine, TIMED_FALLING)
    step_untimed(engine, UNTIMED)
    resting = time_steps(engine, TIMED_RESTING)
    x, y, z = engine.positions_in_tool_frame(0).T
    num_inside = np.count_nonzero((np.maximum(np.abs(x), np.abs(y)) < 0.5 * width) & (z > 0.0))
    engine.close()
    if num_inside < count:
        raise SystemExit(f"{make_engine.__name__}: {count - num_inside} of {count} left the box")
    return falling, resting


def main() -> None:
    """Measure and print the table."""
    parser = make_parser(__doc__, runs=RUNS)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="numbers of lumps")
    options = parser.parse_args()
    warm_up()
    for make_engine in ENGINES:
        time_box(make_engine, 5)
    table = ResultTable(COLUMNS, as_json=options.json, row_width=10)
    table.print_note(f"{describe_load()}; ms per 5 ms step, medians of {options.runs} runs")
    table.print_header("lumps")
    for count in options.counts:
        cases = [partial(time_box, make_engine, count) for make_engine in ENGINES]
        medians = np.median(interleave(cases, options.runs), axis=0).tolist()
        (cubes, cubes_rest), (particles, particles_rest), (_, asleep) = medians
        values = [cubes, particles, cubes / particles]
        values += [cubes_rest, particles_rest, cubes_rest / particles_rest, asleep]
        table.print_row(f"{count}", values)


if __name__ == "__main__":
    main()
