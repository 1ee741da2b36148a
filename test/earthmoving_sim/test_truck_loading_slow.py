"""An excavator loads a dumper, which drives away and tips its load; the ledger stays balanced."""

import numpy as np
import pytest
from support.machine_scenes import load_shipped_machine, loose_soil_options

from dig_operator import BehaviourParams, DigTask, DigTaskParams
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

pytestmark = pytest.mark.slow

GRID = Grid(161, 161, 0.2)
CLEARANCE = 2.8
"""Clearance of the bucket above the ground, so that it clears the dumper's bed [m]."""


def test_dumper_is_loaded_and_tips_its_load_elsewhere() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(repose_angle=35.0, swell=0.15))
    digger, dumper = load_shipped_machine("excavator"), load_shipped_machine("dumper")
    sim = MachineSim(
        [Placement(digger, (-2.0, 0.0)), Placement(dumper, (0.35, 6.3))],
        GRID,
        soil.columns.height,
        particle_params=ParticleParams(nominal_volume=2_000_000),
        **loose_soil_options(soil),
    )
    world = World(soil, {1: sim})
    truck = sim.simulated_machines[1]
    imbalances = set()

    def step(ticks: int) -> None:
        imbalances.update(world.step().imbalance for _ in range(ticks))

    behaviour = BehaviourParams(clearance=CLEARANCE, empty_threshold=0.05)
    task = DigTask(digger, behaviour, DigTaskParams(cycles=2, timeout=120.0))
    operated = OperatedMachine(world, sim.simulated_machines[0], task, sim.params.tick_period)
    while task.phase not in ("settle", "done"):
        operated.observe_and_command(0.02)
        step(2)
    loaded = truck.payload
    assert task.abort_reason == ""
    assert loaded.bank_m3 > 0.0
    assert loaded.mass_kg == pytest.approx(1600.0 * loaded.bank_m3, rel=1e-6)

    sim.command(np.zeros(4), np.zeros(2))
    truck.machine.command([0.0], [-1.5, -1.5])
    step(400)
    truck.machine.command([0.0], [0.0, 0.0])
    step(50)
    assert truck.machine.base_pose[0][0] < -4.0
    assert truck.payload.bank_m3 > 0.9 * loaded.bank_m3, "the load is carried along"
    heap = (GRID.x(np.arange(161)) < -7.0)[:, None] & np.ones(161, bool)
    before = int(soil.columns.bulk[heap].sum())
    truck.machine.command([-0.2], [0.0, 0.0])
    step(800)
    truck.machine.command([0.2], [1.0, 1.0])
    step(600)
    world.close()
    assert truck.payload.bank_m3 == 0.0
    tipped = int(soil.columns.bulk[heap].sum()) - before
    assert tipped * 1e-9 > 0.8 * loaded.bank_m3
    assert sim.particles.num_plate_tunnellings == 0
    assert imbalances == {0}
    ledger = world.ledger
    assert ledger.particles + ledger.in_flight == 0
