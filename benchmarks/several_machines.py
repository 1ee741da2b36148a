"""How many machines work at once in real time: 1 to 4 excavators dig, 1 to 4 road headers cut.

All machines of a row are in one node's simulation and one world, in this process, on one core; each
has its operator. Excavators dig and dump on a plain, road headers cut a face. Run from the
repository root: `python benchmarks/several_machines.py`, with `--seconds` of simulated time;
`--tracks physics` for rigid shoes.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from earthmoving_sim.operated import Operated
from earthmoving_sim.world import World
from machine_sim.core import MachineSim
from machine_sim.machine import load_description
from machine_sim.machine.tracks.model import TRACK_MODELS, TrackModel
from machine_sim.operator import FaceCut, FaceParams, OperatorParams, Shift, ShiftParams
from machine_sim.params import MachineSimParams
from machine_sim.particles import ParticleParams
from machine_sim.work.rig import Placement
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from soil_sim.params import SoilParams
from soil_sim.soil import Soil

MOST = 4
APART = 14.0
"""From machine to machine [m]."""
GRID = Grid(321, 321, 0.2)
SOIL = SoilParams(repose_angle=35.0, swell=0.15)
LOOK_EVERY = 2
"""Ticks."""


def main() -> None:
    """Print a row for each number of machines of each kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=40.0, help="simulated time of each row")
    parser.add_argument("--tracks", choices=TRACK_MODELS, default="fast", help="of which kind")
    asked = parser.parse_args()
    print(f"{'machines':<24}{'x real time':>12}{'ms a tick':>11}{'particles at most':>19}")
    for kind in ("excavator", "road_header"):
        for count in range(1, MOST + 1):
            ratio, each, most = work(kind, count, asked.seconds, asked.tracks)
            print(f"{count} x {kind:<20}{ratio:12.2f}{each:11.2f}{most:19d}", flush=True)


def work(
    kind: str, count: int, seconds: float, tracks: TrackModel = "fast"
) -> tuple[float, float, int]:
    """Let some machines work side by side.

    Returns:
        (simulated over wall time, wall time of a tick [ms], particles at most).
    """
    machine = load_description(find_config(f"machines/{kind}.yaml"))
    places = [(-6.0, (k - 0.5 * (count - 1)) * APART) for k in range(count)]
    heights = np.zeros(GRID.shape)
    if kind == "road_header":
        heights[GRID.x(np.arange(GRID.rows)) > -1.0] = 2.2
    soil = Soil(GRID, heights, SOIL)
    sim = MachineSim(
        [Placement(machine, place) for place in places],
        GRID,
        soil.columns.height,
        params=MachineSimParams(tracks=tracks),
        soils=soil.loose_soils,
        particle_params=ParticleParams(nominal_volume=2_000_000),
    )
    world = World(soil, {1: sim})
    operators: list[Shift | FaceCut] = [
        FaceCut(machine, FaceParams(rounds=100, longest=1e6))
        if kind == "road_header"
        else Shift(machine, OperatorParams(), ShiftParams(cycles=100, approach=0.5, longest=1e6))
        for _ in places
    ]
    tick = sim.params.tick
    operated = [
        Operated(world, rig, operator, tick)
        for rig, operator in zip(sim.rigs, operators, strict=True)
    ]
    most, began = 0, time.perf_counter()
    while world.tick * tick < seconds:
        for each in operated:
            each.act(LOOK_EVERY * tick)
        for _ in range(LOOK_EVERY):
            world.step()
        most = max(most, sim.particles.count)
    wall = time.perf_counter() - began
    ticks = world.tick
    world.close()
    return seconds / wall, 1e3 * wall / ticks, most


if __name__ == "__main__":
    main()
