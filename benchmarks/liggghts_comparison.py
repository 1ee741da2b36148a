"""What particles cost beside LIGGGHTS, on the same heap and in the same run.

The same block of spheres, same places, sizes, weights and coefficients, falls on level ground in
both and comes to rest; ours is kept awake, so that both work. One core each, taking turns. Printed:
wall time per particle and 5 ms while it falls and at rest, medians over the runs; the same
per time step, for a stiffer contact needs shorter ones; and both heaps, which should be alike for
the comparison to be fair (rolling resistance is not the same: theirs is of each contact, ours of a
particle). `benchmarks/liggghts_runner.py` says how LIGGGHTS is set up.

Run from the repository root: `python benchmarks/liggghts_comparison.py`; takes about three
minutes. LIGGGHTS must be installed: `apt-get install liggghts`.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from liggghts_runner import (
    MIN_YOUNGS_MODULUS,
    MISSING,
    ContactCoefficients,
    HeapResult,
    LiggghtsError,
    Spheres,
    fall,
    installed,
    rayleigh_time,
    substeps,
)
from particle_scenes import (
    FALLING,
    STEP,
    HeapShape,
    add_block,
    describe_load,
    flat_ground,
    measure_heap,
    run,
    settle_steps,
    time_steps,
)

from machine_sim.dem import ParticleEngine, ParticleParams, warm_up

COUNTS = (1000, 5000, 20_000)
RUNS = 3
GROUP, GROUPS = 20, 5
"""Steps at rest that are timed together, and how often."""
MAX_HEAP_DIFFERENCE = 0.2
"""Part by which heaps that are alike differ at most, in height, radius and contacts."""


def run_particle_engine(count: int) -> tuple[float, float, HeapShape, Spheres]:
    """Falling and at rest [us per particle and step], the heap, and how it began."""
    engine = ParticleEngine(ParticleParams(capacity=10**6, allow_sleeping=False), flat_ground())
    add_block(engine, count)
    start = as_spheres(engine)
    falling = time_steps(engine, FALLING, group=FALLING)
    run(engine, settle_steps(count))
    rest = time_steps(engine, GROUP * GROUPS, group=GROUP)
    heap = measure_heap(engine.positions, engine.radii)
    return 1e3 * falling / count, 1e3 * rest / count, heap, start


def as_spheres(engine: ParticleEngine) -> Spheres:
    """Particles of one soil, as LIGGGHTS needs to know them."""
    params, coefficients = engine.params, engine.contact_coefficients
    return Spheres(
        position=engine.positions.copy(),
        radius=engine.radii.copy(),
        density=engine.masses / (4.0 / 3.0 * math.pi * engine.radii**3),
        gravity=params.gravity,
        particle_contact=ContactCoefficients(
            float(coefficients.friction[0]),
            float(coefficients.rolling_friction[0]),
            params.restitution,
        ),
        ground=ContactCoefficients(
            params.ground_friction, params.ground_rolling_friction, params.boundary_restitution
        ),
    )


def run_liggghts(
    spheres: Spheres, young: float = MIN_YOUNGS_MODULUS
) -> tuple[float, float, HeapShape]:
    """Falling and at rest in LIGGGHTS [us per particle and step of ours], and the heap."""
    count, per_step = len(spheres.position), substeps(spheres, STEP, young)
    parts = [FALLING, settle_steps(count), *[GROUP] * GROUPS]
    outcome: HeapResult = fall(spheres, STEP / per_step, [n * per_step for n in parts], young)
    scale = 1e6 / count
    falling = scale * outcome.seconds[0] / FALLING
    rest = scale * float(np.median(outcome.seconds[2:])) / GROUP
    return falling, rest, measure_heap(outcome.position, spheres.radius)


def compare(count: int, runs: int, young: float) -> None:
    """Print what `count` particles cost in both, and their heaps."""
    costs = []
    for _ in range(runs):
        falling, rest, heap, spheres = run_particle_engine(count)
        falling_l, rest_l, heap_l = run_liggghts(spheres, young)
        costs.append(((falling, falling_l), (rest, rest_l)))
    steps = (ParticleParams().substeps, substeps(spheres, STEP, young))
    for phase, (mine, its) in zip(("falling", "at rest"), np.median(costs, axis=0), strict=True):
        a, b = mine / steps[0], its / steps[1]
        print(
            f"{count:>7} {phase:<8}{mine:>9.3f}{its:>10.3f}{its / mine:>7.1f}"
            f"{a:>13.4f}{b:>10.4f}{b / a:>7.1f}"
        )
    for name, one, other in (("ours", heap, heap_l), ("LIGGGHTS", heap_l, heap)):
        alike = all(
            abs(getattr(one, f) - getattr(other, f)) < MAX_HEAP_DIFFERENCE * getattr(other, f)
            for f in ("height", "radius", "contacts")
        )
        print(
            f"{'':>8}heap, {name}: {one.height:.2f} m high, {one.radius:.2f} m in radius,"
            f" {one.contacts:.1f} contacts each{'' if alike else ' -- NOT MAX_HEAP_DIFFERENCE'}",
            flush=True,
        )


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    options.add_argument("--runs", type=int, default=RUNS, help="of each; medians are printed")
    options.add_argument(
        "--young",
        type=float,
        default=MIN_YOUNGS_MODULUS,
        help=f"modulus in LIGGGHTS [Pa], from {MIN_YOUNGS_MODULUS:g}",
    )
    given = options.parse_args()
    if not installed():
        raise SystemExit(MISSING)
    warm_up()
    *_, spheres = run_particle_engine(50)  # compiles the rest
    per_step = substeps(spheres, STEP, given.young)
    rayleigh = rayleigh_time(float(spheres.radius[0]), float(spheres.density[0]), given.young)
    share = STEP / per_step / rayleigh
    print(
        f"{describe_load()}; medians of {given.runs} runs\n"
        f"ours: time step {1e3 * STEP / ParticleParams().substeps:.3g} ms\n"
        f"LIGGGHTS: Young's modulus {given.young:.3g} Pa, time step {1e3 * STEP / per_step:.3g} ms,"
        f" {100 * share:.0f} % of the Rayleigh time\n\n"
        f"{'us per particle':<16}{'per 5 ms':^26}{'per time step':>24}\n"
        f"{'N':>7}{'':<9}" + f"{'ours':>9}{'LIGGGHTS':>10}{'ratio':>7}    " * 2
    )
    try:
        for count in given.counts:
            compare(count, given.runs, given.young)
    except LiggghtsError as error:
        raise SystemExit(str(error)) from error


if __name__ == "__main__":
    main()
