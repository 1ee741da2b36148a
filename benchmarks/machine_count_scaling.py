"""How many machines work at once in real time: 1 to 4 excavators dig, 1 to 4 road headers cut.

All machines of a row are in one node's simulation and one world, in this process, on one core; each
has its operator. Excavators dig and dump on a plain, road headers cut a face. Run from the
repository root: `python benchmarks/machine_count_scaling.py`, with `--seconds` of simulated time;
`--tracks dynamic` for rigid shoes.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from dig_operator import BehaviourParams, DigTask, DigTaskParams, FaceCuttingParams, FaceCuttingTask
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams
from machine_sim.machine import load_machine_spec
from machine_sim.machine.tracks.track_model import TRACK_MODELS, TrackModel
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

MAX_MACHINES = 4
SPACING = 14.0
"""From machine to machine [m]."""
GRID = Grid(321, 321, 0.2)
SOIL = SoilParams(repose_angle=35.0, swell=0.15)
COMMAND_INTERVAL_TICKS = 2
"""Ticks."""


def main() -> None:
    """Print a row for each number of machines of each kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=40.0, help="simulated time of each row")
    parser.add_argument("--tracks", choices=TRACK_MODELS, default="kinematic", help="of which kind")
    asked = parser.parse_args()
    print(f"{'machines':<24}{'x real time':>12}{'ms a tick':>11}{'particles at most':>19}")
    for kind in ("excavator", "road_header"):
        for count in range(1, MAX_MACHINES + 1):
            ratio, each, most = run_machines(kind, count, asked.seconds, asked.tracks)
            print(f"{count} x {kind:<20}{ratio:12.2f}{each:11.2f}{most:19d}", flush=True)


def run_machines(
    kind: str, count: int, seconds: float, tracks: TrackModel = "kinematic"
) -> tuple[float, float, int]:
    """Let some machines work side by side.

    Returns:
        (simulated over wall time, wall time of a tick [ms], particles at most).
    """
    machine = load_machine_spec(find_config(f"machines/{kind}.yaml"))
    places = [(-6.0, (k - 0.5 * (count - 1)) * SPACING) for k in range(count)]
    heights = np.zeros(GRID.shape)
    if kind == "road_header":
        heights[GRID.x(np.arange(GRID.rows)) > -1.0] = 2.2
    soil = Soil(GRID, heights, SOIL)
    sim = MachineSim(
        [Placement(machine, place) for place in places],
        GRID,
        soil.columns.height,
        params=MachineSimParams(track_model=tracks),
        soils=soil.loose_soils,
        particle_params=ParticleParams(nominal_volume=2_000_000),
    )
    world = World(soil, {1: sim})
    operators: list[DigTask | FaceCuttingTask] = [
        FaceCuttingTask(machine, FaceCuttingParams(rounds=100, timeout=1e6))
        if kind == "road_header"
        else DigTask(
            machine,
            BehaviourParams(),
            DigTaskParams(cycles=100, approach_distance=0.5, timeout=1e6),
        )
        for _ in places
    ]
    tick = sim.params.tick_period
    operated = [
        OperatedMachine(world, rig, operator, tick)
        for rig, operator in zip(sim.simulated_machines, operators, strict=True)
    ]
    most, began = 0, time.perf_counter()
    while world.tick * tick < seconds:
        for each in operated:
            each.observe_and_command(COMMAND_INTERVAL_TICKS * tick)
        for _ in range(COMMAND_INTERVAL_TICKS):
            world.step()
        most = max(most, sim.particles.count)
    wall = time.perf_counter() - began
    ticks = world.tick
    world.close()
    return seconds / wall, 1e3 * wall / ticks, most


if __name__ == "__main__":
    main()
