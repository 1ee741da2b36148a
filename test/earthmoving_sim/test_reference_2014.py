"""The set-up of the 2014 reference in `config/reference_2014.yaml`: its values, and a dig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams
from machine_sim.machine import load_machine_spec
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.node.params import MachineNodeParams
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from soil_sim.node.params import SoilNodeParams
from soil_sim.site.site import SiteParams
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams


def sections(node: str) -> dict:
    content = yaml.safe_load(find_config("reference_2014.yaml").read_text(encoding="utf-8"))
    return content[node]["ros__parameters"]


@pytest.fixture
def soil_params() -> SoilParams:
    return SoilParams.from_mapping(sections("soil_sim")["soil"])


@pytest.fixture
def machine():
    return load_machine_spec(find_config(sections("/**/machine_sim")["machine"]))


def test_values_are_those_of_the_reference(soil_params, machine) -> None:
    own = sections("soil_sim")
    site = SiteParams.from_mapping(own["site"])
    assert (site.num_points - 1) * site.cell == pytest.approx(102.4)
    assert SoilNodeParams(tick_period=own["tick_period"]).tick_period == 0.005
    assert (soil_params.repose_angle, soil_params.swell, soil_params.cut_mode) == (
        30.0,
        0.0,
        "reference",
    )
    assert 7 * soil_params.num_interpolated_key_points == 56
    machine_values = sections("/**/machine_sim")
    assert (
        MachineNodeParams(machine=machine_values["machine"]).machine
        == "machines/reference_2014.yaml"
    )
    assert MachineSimParams(**machine_values["stepping"]).physics_step == 0.005
    assert machine_values["particles"]["mode"] == "cubes"
    assert ParticleParams(**machine_values["particles"]).nominal_volume == 400**3
    masses = {name: link.mass for name, link in machine.links.items()}
    body = masses["base"] + masses["upper"]
    parts = np.array([body, masses["boom"], masses["arm"], masses["bucket"]])
    assert (parts / masses["bucket"]).tolist() == [10.0, 2.0, 2.0, 1.0]


def test_dig_is_balanced_at_every_tick(soil_params, machine) -> None:
    grid = Grid(65, 65, 0.4)  # smaller than the reference's: the dig needs no more
    soil = Soil(grid, np.zeros(grid.shape), soil_params)
    down = -arm_geometry(machine).swing[2]
    machine = replace(
        machine, home=np.array([0.0, *solve_arm_angles(machine, 7.0, down + 0.1, 2.0)])
    )
    sim = MachineSim(
        [Placement(machine)],
        grid,
        soil.columns.height,
        params=MachineSimParams(**sections("/**/machine_sim")["stepping"], steps_per_tick=1),
        particle_params=ParticleParams(**sections("/**/machine_sim")["particles"]),
    )
    world = World(soil, {1: sim})
    max_particles, imbalances = 0, set()
    for tick in range(500):
        fraction = tick / 500
        wanted = solve_arm_angles(
            machine, 7.0 - 2.0 * fraction, down - 0.5 * np.sin(np.pi * fraction), 2.0
        )
        sim.command(
            np.array([0.0, *(5.0 * (wanted - sim.machine.joint_positions[1:]))]), np.zeros(2)
        )
        imbalances.add(world.step().imbalance)
        max_particles = max(max_particles, sim.particles.count)
    world.close()
    assert imbalances == {0}
    assert max_particles > 0
    assert not any(np.isnan(sim.particles.positions).ravel())
