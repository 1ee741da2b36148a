"""A heaped bucket keeps its load in a full-lever swing, which takes as long as a real one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import GRID, excavator

from machine_sim.dem import ParticleParams
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

EXCAVATOR = excavator()
VOLUME = 4_000_000
"""Bank volume of a particle [mm^3]."""
REACH, HEIGHT, PITCH = 5.5, 1.0, 2.95
"""Lip's distance from the swing axis and height [m], and pitch of the bucket [rad], where it is
filled: its opening is about level and clear of the ground."""
LIFT = 0.8
"""Rise of the bucket with the lever of the boom at its end [m]; it runs on by half as much."""
RELEASE_ANGLE = math.radians(37.0)
"""Swing angle at which the lever is released, for a swing of about 90 degrees."""
STILL = np.zeros(2)


def loose_soil(name: str, moisture: int) -> LooseSoil:
    """Return a shipped soil at a moisture [% of saturation]."""
    (soil,) = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil=name)).loose_soils
    return replace(soil, moisture=moisture)


def loaded_excavator(soil: LooseSoil, seed: int = 1) -> MachineSim:
    """Return an excavator on firm ground whose bucket was heaped from above and lifted.

    Args:
        soil: soil in the bucket.
        seed: seed of the scatter of the particles.
    """
    hip = arm_geometry(EXCAVATOR).swing[2]
    home = np.array([0.0, *solve_arm_angles(EXCAVATOR, REACH, HEIGHT - hip, PITCH)])
    home.setflags(write=False)
    sim = MachineSim(
        [Placement(replace(EXCAVATOR, home=home))],
        GRID,
        np.zeros(GRID.shape),
        params=MachineSimParams(),
        particle_params=ParticleParams(nominal_volume=VOLUME),
        soils=[LooseSoil(), soil],
    )
    for _ in range(20):
        sim.step()
    bucket, (rotation, origin) = EXCAVATOR.bucket, sim.machine.tool.pose
    lip, rim = (
        rotation @ np.array([x, 0.0, z]) + origin
        for x, z in (bucket.profile[0], bucket.profile[-1])
    )
    along, across = np.linspace(0.15, 0.85, 5), np.linspace(-0.45, 0.45, 5)
    layer = np.array([rim + a * (lip - rim) + [0.0, y, 0.25] for a in along for y in across])
    layer[:, 2] = max(lip[2], rim[2]) + 0.25
    target = 1.25 * bucket.heaped_capacity / (1.0 + soil.swell)  # some falls off the heap
    rng = np.random.default_rng(seed)
    for _ in range(round(target / (len(layer) * VOLUME * 1e-9))):
        sim.particles.add(
            layer + rng.uniform(-0.03, 0.03, layer.shape),
            np.zeros_like(layer),
            np.full(len(layer), VOLUME),
            np.full(len(layer), 1, dtype=np.uint8),
            np.full(len(layer), round(soil.moisture), dtype=np.uint8),
        )
        for _ in range(25):
            sim.step()
    for _ in range(150):
        sim.step()
    lift(sim)
    return sim


def lift(sim: MachineSim) -> None:
    """Lift the bucket at full lever at constant pitch, and wait until loose soil has slid off."""
    machine = sim.machine
    start, pitch = machine.tool.pose[1][2], sum(machine.joint_positions[1:])
    boom = -EXCAVATOR.joints["boom"].max_velocity
    for _ in range(300):
        if machine.tool.pose[1][2] - start > LIFT:
            boom = 0.0
        curl = 4.0 * (pitch - sum(machine.joint_positions[1:])) - machine.joint_velocities[1]
        sim.command(np.array([0.0, boom, 0.0, curl]), STILL)
        sim.step()
    assert machine.tool.pose[1][2] - start == pytest.approx(1.5 * LIFT, abs=0.3)


def swing_by_90_degrees(sim: MachineSim) -> float:
    """Swing at full lever, release the lever halfway and wait for rest; return the time [s]."""
    machine, seconds = sim.machine, 0.0
    while abs(machine.joint_velocities[0]) > 0.01 or seconds < 1.0:
        is_driven = machine.joint_positions[0] < RELEASE_ANGLE
        full_lever = EXCAVATOR.joints["swing"].max_velocity if is_driven else 0.0
        sim.command(np.array([full_lever, 0.0, 0.0, 0.0]), STILL)
        sim.step()
        seconds += sim.params.tick_period
    return seconds


@pytest.mark.parametrize(
    ("name", "moisture", "min_kept"),
    [("gravel", 0, 0.90), ("loam", 40, 0.92), ("topsoil", 30, 0.92)],
)
def test_full_lever_swing_keeps_the_load(name: str, moisture: int, min_kept: float) -> None:
    """The mean of three fills; single fills keep 95 to 97 %, with a deviation of 1.3 to 2.5 %."""
    kept = []
    for seed in range(3):
        sim = loaded_excavator(loose_soil(name, moisture), seed)
        before = sim.payload
        assert before.fill > 0.85
        seconds = swing_by_90_degrees(sim)
        assert math.degrees(sim.machine.joint_positions[0]) == pytest.approx(90.0, abs=6.0)
        assert seconds == pytest.approx(3.5, abs=0.3)
        for _ in range(60):
            sim.step()
        kept.append(sim.payload.mass_kg / before.mass_kg)
        sim.close()
    assert np.mean(kept) >= min_kept
