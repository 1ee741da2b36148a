"""Compare the cost of particles with LIGGGHTS on the same heap in the same run.

    python -m benchmarks.liggghts_comparison       # about three minutes

The same block of spheres (positions, sizes, masses and coefficients) falls on level ground in both
programs and comes to rest; this project's particles are kept awake, so that both solve contacts.
Each uses one core, in turn. Printed are medians over the runs of the wall time per particle and
5 ms, while falling and at rest, the same per time step (a stiffer contact needs shorter steps),
and the shape of both heaps, which should be similar for the comparison to be fair. Rolling
resistance is not the same: LIGGGHTS has one for each contact, this project one for each particle.
`liggghts_runner` has the set-up of LIGGGHTS, which must be installed: `apt-get install liggghts`.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks.liggghts_runner import (
    INSTALL_HINT,
    MIN_YOUNGS_MODULUS,
    ContactCoefficients,
    LiggghtsError,
    Spheres,
    drop_spheres,
    is_installed,
    rayleigh_time,
    substeps,
)
from benchmarks.particle_scenes import (
    FALLING_STEPS,
    REST_GROUP,
    REST_GROUPS,
    STEP,
    HeapShape,
    add_block,
    flat_ground,
    measure_heap,
    settle_steps,
    step_untimed,
    time_steps,
)
from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from machine_sim.dem import ParticleEngine, ParticleParams, warm_up

COUNTS = (1000, 5000, 20_000)
RUNS = 3
MAX_HEAP_DIFFERENCE = 0.2
"""Maximum relative difference of similar heaps in height, radius and contacts."""

COLUMNS = (
    *(Column("particles", "us"), Column("LIGGGHTS", "us"), Column("ratio", "", ".1f")),
    *(Column("particles, step", "us", ".4f"), Column("LIGGGHTS, step", "us", ".4f")),
    Column("ratio, step", "", ".1f"),
)


def run_particle_engine(count: int) -> tuple[float, float, HeapShape, Spheres]:
    """Drop a block of particles.

    Returns:
        (time while falling, time at rest [us per particle and 5 ms], the heap, the spheres at the
        start).
    """
    engine = ParticleEngine(ParticleParams(capacity=10**6, allow_sleeping=False), flat_ground())
    add_block(engine, count)
    start = as_spheres(engine)
    falling = time_steps(engine, FALLING_STEPS, group=FALLING_STEPS)
    step_untimed(engine, settle_steps(count))
    resting = time_steps(engine, REST_GROUP * REST_GROUPS, group=REST_GROUP)
    heap = measure_heap(engine.positions, engine.radii)
    return 1e3 * falling / count, 1e3 * resting / count, heap, start


def as_spheres(engine: ParticleEngine) -> Spheres:
    """Return particles of one soil as input for LIGGGHTS."""
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
        ground_contact=ContactCoefficients(
            params.ground_friction, params.ground_rolling_friction, params.boundary_restitution
        ),
    )


def run_liggghts(
    spheres: Spheres, youngs_modulus: float = MIN_YOUNGS_MODULUS
) -> tuple[float, float, HeapShape]:
    """Drop the same block in LIGGGHTS.

    Returns:
        (time while falling, time at rest [us per particle and 5 ms], the heap).
    """
    count, per_step = len(spheres.position), substeps(spheres, STEP, youngs_modulus)
    parts = [FALLING_STEPS, settle_steps(count), *[REST_GROUP] * REST_GROUPS]
    outcome = drop_spheres(
        spheres, STEP / per_step, [steps * per_step for steps in parts], youngs_modulus
    )
    scale = 1e6 / count
    falling = scale * outcome.seconds[0] / FALLING_STEPS
    resting = scale * float(np.median(outcome.seconds[2:])) / REST_GROUP
    return falling, resting, measure_heap(outcome.position, spheres.radius)


def compare(table: ResultTable, count: int, runs: int, youngs_modulus: float) -> None:
    """Measure `count` particles in both programs; print times and heaps."""
    costs = []
    for _ in range(runs):
        falling, resting, heap, spheres = run_particle_engine(count)
        peer_falling, peer_resting, peer_heap = run_liggghts(spheres, youngs_modulus)
        costs.append(((falling, peer_falling), (resting, peer_resting)))
    own_steps = ParticleParams().substeps
    peer_steps = substeps(spheres, STEP, youngs_modulus)
    for phase, (own, peer) in zip(
        ("falling", "at rest"), np.median(costs, axis=0).tolist(), strict=True
    ):
        own_step, peer_step = own / own_steps, peer / peer_steps
        values = [own, peer, peer / own, own_step, peer_step, peer_step / own_step]
        table.print_row(f"{count} {phase}", values)
    for name, shape in (("particles", heap), ("LIGGGHTS", peer_heap)):
        table.print_note(
            f"  heap, {name}: {shape.height:.2f} m high, {shape.radius:.2f} m in radius,"
            f" {shape.contacts:.1f} contacts per particle"
        )
    if not heap.is_similar(peer_heap, MAX_HEAP_DIFFERENCE):
        table.print_note(f"  heaps differ by more than {100 * MAX_HEAP_DIFFERENCE:.0f} %")


def main() -> None:
    """Measure and print the table."""
    parser = make_parser(__doc__, runs=RUNS)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="particle numbers")
    parser.add_argument(
        "--youngs-modulus",
        type=float,
        default=MIN_YOUNGS_MODULUS,
        help=f"Young's modulus in LIGGGHTS [Pa], at least {MIN_YOUNGS_MODULUS:g}",
    )
    options = parser.parse_args()
    if not is_installed():
        raise SystemExit(INSTALL_HINT)
    warm_up()
    *_, spheres = run_particle_engine(50)  # compiles the kernels that warm_up does not
    modulus = options.youngs_modulus
    timestep = STEP / substeps(spheres, STEP, modulus)
    rayleigh = rayleigh_time(float(spheres.radius[0]), float(spheres.density[0]), modulus)
    table = ResultTable(COLUMNS, as_json=options.json, row_width=16)
    table.print_note(
        f"{describe_load()}; us per particle and 5 ms or time step, medians of {options.runs} runs"
        f"\nparticles: time step {1e3 * STEP / ParticleParams().substeps:.3g} ms"
        f"\nLIGGGHTS: Young's modulus {modulus:.3g} Pa, time step {1e3 * timestep:.3g} ms,"
        f" {100 * timestep / rayleigh:.0f} % of the Rayleigh time"
    )
    table.print_header()
    try:
        for count in options.counts:
            compare(table, count, options.runs, modulus)
    except LiggghtsError as error:
        raise SystemExit(str(error)) from error


if __name__ == "__main__":
    main()
