"""An excavator loads a dumper, which carries the soil away and tips it: the ledger closes."""

import numpy as np
import pytest
from support.machine_scenes import loosened, shipped

from earthmoving_sim.operated import Operated
from earthmoving_sim.world import World
from machine_sim.core import MachineSim
from machine_sim.operator import OperatorParams, Shift, ShiftParams
from machine_sim.particles import ParticleParams
from machine_sim.work.rig import Placement
from msg_bridge.contract.grid import Grid
from soil_sim.params import SoilParams
from soil_sim.soil import Soil

pytestmark = pytest.mark.slow

GRID = Grid(161, 161, 0.2)
OVER_THE_RIM = 2.8
"""Height that the bucket keeps above the ground, so that it clears the dumper's bed [m]."""


def test_a_truck_is_loaded_and_tips_its_load_elsewhere() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(repose_angle=35.0, swell=0.15))
    digger, dumper = shipped("excavator"), shipped("dumper")
    sim = MachineSim(
        [Placement(digger, (-2.0, 0.0)), Placement(dumper, (0.35, 6.3))],
        GRID,
        soil.columns.height,
        particle_params=ParticleParams(nominal_volume=2_000_000),
        **loosened(soil),
    )
    world = World(soil, {1: sim})
    truck = sim.rigs[1]
    imbalances = set()

    def go_on(ticks: int) -> None:
        imbalances.update(world.step().imbalance for _ in range(ticks))

    habits = OperatorParams(clearance=OVER_THE_RIM, empty=0.05)
    operator = Shift(digger, habits, ShiftParams(cycles=2, longest=120.0))
    operated = Operated(world, sim.rigs[0], operator, sim.params.tick)
    while operator.phase not in ("settle", "done"):
        operated.act(0.02)
        go_on(2)
    loaded = truck.payload
    assert operator.given_up == ""
    assert loaded.bank > 0.8
    assert loaded.mass == pytest.approx(1600.0 * loaded.bank, rel=1e-6)

    sim.command(np.zeros(4), np.zeros(2))
    truck.machine.command([0.0], [-1.5, -1.5])
    go_on(400)
    truck.machine.command([0.0], [0.0, 0.0])
    go_on(50)
    assert truck.machine.base_pose[0][0] < -4.0
    assert truck.payload.bank > 0.98 * loaded.bank
    heap = (GRID.x(np.arange(161)) < -7.0)[:, None] & np.ones(161, bool)
    before = int(soil.columns.bulk[heap].sum())
    truck.machine.command([-0.2], [0.0, 0.0])
    go_on(800)
    truck.machine.command([0.2], [1.0, 1.0])
    go_on(600)
    world.close()
    assert truck.payload.bank == 0.0
    grown = int(soil.columns.bulk[heap].sum()) - before
    assert grown * 1e-9 > 0.9 * loaded.bank
    assert sim.particles.tunnelled_tool == 0
    assert imbalances == {0}
    ledger = world.ledger
    assert ledger.particles + ledger.in_flight == 0
