"""A machine that drives over loose soil packs it under its tracks, and nothing is lost."""

from __future__ import annotations

import numpy as np
from support.machine_scenes import excavator, loosened
from support.soil_scenes import NO_SWEEPS, landings

from earthmoving_sim.world import World
from machine_sim.core import MachineSim
from machine_sim.rig import Placement
from msg_bridge.contract.grid import Grid
from soil_sim.params import SoilParams
from soil_sim.soil import Soil

GRID = Grid(81, 61, 0.2)
DEPTH = 0.2  # of loose soil [m]


def loose_ground() -> Soil:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(swell=0.3))
    volume = round(DEPTH / 1.3 / soil.columns.metres_per_mm3)
    x, y = np.meshgrid(GRID.x(np.arange(81)), GRID.y(np.arange(61)), indexing="ij")
    soil.step(0, NO_SWEEPS, landings(x.reshape(-1), y.reshape(-1), volume))
    return soil


def test_tracks_leave_ruts_where_they_went_and_nowhere_else() -> None:
    soil = loose_ground()
    machine = MachineSim(
        [Placement(excavator(), (-4.0, 0.0))], GRID, soil.columns.height, **loosened(soil)
    )
    world = World(soil, {1: machine})
    start = machine.machine.base_pose[0][0]
    machine.command(np.zeros(4), np.array([1.0, 1.0]))
    imbalances = {world.step().imbalance for _ in range(300)}
    end = machine.machine.base_pose[0][0]
    world.close()
    assert imbalances == {0}
    assert end - start > 2.0
    tracks = machine.machine.description.tracks
    sunk = DEPTH - soil.columns.height
    row = round(GRID.row(0.5 * (start + end)))
    left, right = round(GRID.col(0.5 * tracks.gauge)), round(GRID.col(-0.5 * tracks.gauge))
    middle, beside = round(GRID.col(0.0)), round(GRID.col(3.0))
    assert min(sunk[row, left], sunk[row, right]) > 0.01
    assert abs(sunk[row, middle]) < 1e-6
    assert abs(sunk[row, beside]) < 1e-6
    assert abs(sunk[round(GRID.row(end + 3.0)), left]) < 1e-6, "not before it came"
    assert sunk.max() <= DEPTH * (1.0 - 1.0 / 1.3) + 1e-3, "no denser than undisturbed"
