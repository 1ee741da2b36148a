"""Measure how many machines run in real time: 1 to 4 excavators dig, 1 to 4 road headers cut.

    python -m benchmarks.machine_count_scaling --seconds 40 --tracks kinematic

All machines of a row are in one simulation and one world, in this process, on one core; each has
its own operator. Excavators dig and dump on a plain, road headers cut a face.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from dig_operator import BehaviourParams, DigTask, DigTaskParams, FaceCuttingParams, FaceCuttingTask
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams
from machine_sim.machine import MachineSpec, load_machine_spec
from machine_sim.machine.tracks.track_model import TRACK_MODELS, TrackModel
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

KINDS = ("excavator", "road_header")
MAX_MACHINES = 4
SPACING = 14.0
"""Distance between neighbouring machines [m]."""
GRID = Grid(321, 321, 0.2)
SOIL = SoilParams(repose_angle=35.0, swell=0.15)
WARM_UP_SECONDS = 3.0
"""Simulated time of an excavator until it digs, before the measurement [s]."""
COMMAND_INTERVAL_TICKS = 2
"""Ticks between commands of an operator."""

COLUMNS = (
    Column("real-time factor", "", ".2f"),
    Column("tick [ms]", "ms", ".2f"),
    Column("max particles", "", "d"),
)


class ScalingResult(NamedTuple):
    """Cost of some machines that work side by side.

    Attributes:
        real_time_factor: simulated over wall time.
        tick_time: mean wall time of a tick [ms].
        max_particles: maximum number of particles at once.
    """

    real_time_factor: float
    tick_time: float
    max_particles: int


def main() -> None:
    """Measure and print a row for each number of machines of each kind."""
    parser = make_parser(__doc__)
    parser.add_argument("--seconds", type=float, default=40.0, help="simulated time of a row (40)")
    parser.add_argument("--tracks", choices=TRACK_MODELS, default="kinematic", help="track model")
    parser.add_argument(
        "--counts", type=int, nargs="+", default=range(1, MAX_MACHINES + 1), help="machines"
    )
    options = parser.parse_args()
    table = ResultTable(COLUMNS, as_json=options.json)
    table.print_note(describe_load())
    table.print_header("machines")
    for kind in KINDS:
        run_machines(kind, 1, WARM_UP_SECONDS, options.tracks)  # compiles kernels
        for count in options.counts:
            result = run_machines(kind, count, options.seconds, options.tracks)
            table.print_row(f"{count} x {kind}", result)


def run_machines(
    kind: str, count: int, seconds: float, tracks: TrackModel = "kinematic"
) -> ScalingResult:
    """Run some machines of one kind side by side for some simulated seconds."""
    spec = load_machine_spec(find_config(f"machines/{kind}.yaml"))
    positions = [(-6.0, (k - 0.5 * (count - 1)) * SPACING) for k in range(count)]
    heights = np.zeros(GRID.shape)
    if kind == "road_header":
        heights[GRID.x(np.arange(GRID.rows)) > -1.0] = 2.2
    soil = Soil(GRID, heights, SOIL)
    sim = MachineSim(
        [Placement(spec, position) for position in positions],
        GRID,
        soil.columns.height,
        params=MachineSimParams(track_model=tracks),
        soils=soil.loose_soils,
        particle_params=ParticleParams(nominal_volume=2_000_000),
    )
    world, tick_period = World(soil, {1: sim}), sim.params.tick_period
    machines = [
        OperatedMachine(world, machine, make_operator(kind, spec), tick_period)
        for machine in sim.simulated_machines
    ]
    max_particles, start = 0, time.perf_counter()
    while world.tick * tick_period < seconds:
        for machine in machines:
            machine.observe_and_command(COMMAND_INTERVAL_TICKS * tick_period)
        for _ in range(COMMAND_INTERVAL_TICKS):
            world.step()
        max_particles = max(max_particles, sim.particles.count)
    wall_time = time.perf_counter() - start
    num_ticks = world.tick
    world.close()
    return ScalingResult(seconds / wall_time, 1e3 * wall_time / num_ticks, max_particles)


def make_operator(kind: str, spec: MachineSpec) -> DigTask | FaceCuttingTask:
    """Return an operator with more work than the measurement has time for."""
    if kind == "road_header":
        return FaceCuttingTask(spec, FaceCuttingParams(rounds=100, timeout=1e6))
    task = DigTaskParams(cycles=100, approach_distance=0.5, timeout=1e6)
    return DigTask(spec, BehaviourParams(), task)


if __name__ == "__main__":
    main()
