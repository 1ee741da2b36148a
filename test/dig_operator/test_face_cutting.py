"""The road header's operator: what it asks of a machine, and a face that it cuts in passes."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import excavator, load_shipped_machine, loose_soil_options

from dig_operator import FaceCuttingParams, FaceCuttingTask, Observation
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams
from machine_sim.machine import MachineError
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

HEADER = load_shipped_machine("road_header")
GRID = Grid(101, 101, 0.1)
FACE = 2.2
"""Where the face stands [m]."""
DT = 0.02


def seen(time: float = 0.0, joints=(0.0, 0.0, 0.0), x: float = 0.0) -> Observation:
    return Observation(
        time, np.array(joints), np.array([x, 0, 0]), np.eye(3), 0.0, GRID, np.zeros((2, 2))
    )


def test_it_wants_a_road_header_and_a_face_in_reach() -> None:
    with pytest.raises(MachineError, match="give a machine with turn, lift, head"):
        FaceCuttingTask(excavator(), FaceCuttingParams())
    with pytest.raises(MachineError, match="has no drum"):
        FaceCuttingTask(replace(HEADER, tools={}), FaceCuttingParams())
    with pytest.raises(MachineError, match="not as wide"):
        FaceCuttingTask(HEADER, FaceCuttingParams(width=6.5))
    with pytest.raises(MachineError, match=r"the head reaches 5\.5; give that or less"):
        FaceCuttingTask(HEADER, FaceCuttingParams(head_angular_velocity=7.0))
    for small in ({"width": 1.0}, {"height": 0.5}):
        with pytest.raises(MachineError, match=r"smaller than the head; give a width from 1\.3 m"):
            FaceCuttingTask(HEADER, FaceCuttingParams(**small))
    with pytest.raises(MachineError, match="another height"):
        FaceCuttingTask(HEADER, FaceCuttingParams(height=6.0))


def test_it_spins_the_head_before_it_drives() -> None:
    operator = FaceCuttingTask(HEADER, FaceCuttingParams())
    command = operator.command(seen(), DT)
    assert command.joints[2] == FaceCuttingParams().head_angular_velocity
    assert not command.tracks.any()
    assert operator.phase == "start"


def test_it_gives_up_where_there_is_no_face() -> None:
    operator = FaceCuttingTask(HEADER, FaceCuttingParams(approach=1.0))
    head, x = 0.0, 0.0
    joints = [
        operator._slew_direction * operator._max_turn_angle,
        operator._lift_angle(operator._row_heights[0]),
    ]
    for k in range(2000):
        head += operator._task.head_angular_velocity * DT
        command = operator.command(seen(k * DT, (*joints, head), x), DT)
        x += float(command.tracks.mean()) * DT
        if operator.done:
            break
    assert "no face within 1 m" in operator.abort_reason
    assert not operator.command(seen(99.0, (*joints, head), x), DT).joints.any()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["loam", "rock"])
def test_it_cuts_a_face_in_passes(kind: str) -> None:
    x = GRID.x(np.arange(GRID.rows))
    heights, ids = np.zeros(GRID.shape), np.zeros(GRID.shape, np.uint8)
    heights[x > FACE], ids[x > FACE - 0.2] = 1.8, 1
    soil = Soil(GRID, heights, SoilParams(soil="loam", additional_soils=[kind]), soil=ids)
    sim = MachineSim(
        [Placement(HEADER, (-2.9, 0.0))],
        GRID,
        soil.columns.height,
        particle_params=ParticleParams(nominal_volume=4_000_000),
        **loose_soil_options(soil),
    )
    world = World(soil, {1: sim})
    before = soil.columns.height.copy()
    operator = FaceCuttingTask(
        HEADER, FaceCuttingParams(width=2.6, height=1.6, rounds=1, timeout=200.0)
    )
    phases, imbalances, torque = set(), set(), 0.0
    operated = OperatedMachine(world, sim.simulated_machines[0], operator, sim.params.tick_period)
    while not operator.done:
        operated.observe_and_command(DT)
        for _ in range(2):
            imbalances.add(world.step().imbalance)
        phases.add(operator.phase)
        torque = max(torque, sim.machine.joint_efforts[2])
    loss = before - soil.columns.height
    world.close()
    assert operator.abort_reason == ""
    assert imbalances == {0}
    assert phases >= {"sump", "slew", "rise", "lower", "back", "done"}
    # The foot of the face is gone over the width of the cut, and stands beside it.
    row = int(np.argmin(np.abs(x - FACE - 0.1)))
    y = GRID.y(np.arange(GRID.cols))
    assert loss[row, np.abs(y) < 1.0].mean() > 0.8
    assert np.abs(loss[row, np.abs(y) > 4.0]).max() < 0.3
    assert torque > 10e3
