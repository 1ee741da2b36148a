"""What a 5 ms step costs with soil as rigid cubes in pybullet, and with particles.

The same soil falls into the same open box and comes to rest: N rigid cubes with the constraints of
the 2014 reference (`machine_sim.reference_cubes`), and N particles that are kept awake, so that
both work.
Particles that may fall asleep, as shipped, are shown too. The box stands still. Medians over the
runs of the median wall time per step; the engines take turns. Run from the repository root:
`python benchmarks/cubes_in_box.py`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from particle_scenes import VOLUME, Engine, block, box, flat_ground, run, time_steps

from machine_sim.dem import ParticleEngine, ParticleParams, Pose, warm_up
from machine_sim.reference_cubes import CubeEngine
from msg_bridge.contract.loose_soil import LooseSoil

COUNTS = (25, 50, 100, 200, 400)
RUNS = 5
SOIL = LooseSoil(swell=0.25)
FALLING, PAUSE, RESTING = 100, 400, 100
"""Steps timed from the start, not timed, and timed at rest."""


def cubes() -> Engine:
    """Rigid cubes in pybullet."""
    return CubeEngine(ParticleParams(), flat_ground(), soils=[SOIL])


def awake() -> Engine:
    """Particles that never sleep."""
    return ParticleEngine(ParticleParams(allow_sleeping=False), flat_ground(), soils=[SOIL])


def shipped() -> Engine:
    """Particles with parameters as shipped."""
    return ParticleEngine(ParticleParams(), flat_ground(), soils=[SOIL])


def in_box(make: Callable[[], Engine], count: int) -> tuple[float, float]:
    """Soil in a box [ms a step]: while it falls in, and at rest."""
    engine = make()
    edge = (VOLUME * 1e-9 * (1.0 + SOIL.swell)) ** (1 / 3)
    width = max(0.4, 1.1 * edge * (count / 0.6) ** (1 / 3))
    pose: Pose = (np.eye(3), np.array([0.0, 0.0, 0.5]))
    engine.add_tool(0, box(width, 2.0 * width), pose, digs=False)
    points = block(count, 1.3 * edge, width - 1.5 * edge, 0.5 + edge)
    engine.add(points, np.zeros_like(points), VOLUME, grow=False)
    falling = time_steps(engine, FALLING)
    run(engine, PAUSE)
    resting = time_steps(engine, RESTING)
    x, y, z = engine.positions_in_tool_frame(0).T
    inside = (np.maximum(np.abs(x), np.abs(y)) < 0.5 * width) & (z > 0.0)
    if not inside.all():
        print(f"  {make.__name__}: {np.count_nonzero(~inside)} of {count} are not in the box")
    engine.close()
    return falling, resting


def main() -> None:
    """Print the table."""
    warm_up()
    makers = (cubes, awake, shipped)
    for make in makers:
        in_box(make, 5)
    print("ms per 5 ms step in a box that stands still, median of", RUNS, "runs")
    print(f"{'':>6} {'falling in':^32} {'at rest':^42}")
    columns = ("cubes", "particles", "ratio")
    print(f"{'N':>6}", *(f"{name:>10}" for name in (*columns, *columns, "asleep")))
    for count in COUNTS:
        runs = np.array([[in_box(make, count) for make in makers] for _ in range(RUNS)])
        (fall, rest), (fall_p, rest_p), (_, asleep) = np.median(runs, axis=0)
        cells = (fall, fall_p, fall / fall_p, rest, rest_p, rest / rest_p, asleep)
        print(f"{count:>6}", *(f"{cell:>10.3f}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
