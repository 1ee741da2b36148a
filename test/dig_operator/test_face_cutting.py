"""FaceCuttingTask: requirements on the machine, and a face that is cut in passes."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import excavator, load_shipped_machine, loose_soil_options

from dig_operator import FaceCuttingParams, FaceCuttingTask, Observation
from dig_operator.face_geometry import FaceGeometry
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
FACE_X = 2.2
"""Position of the face [m]."""
DT = 0.02


def observation(time: float = 0.0, joints=(0.0, 0.0, 0.0), x: float = 0.0) -> Observation:
    return Observation(
        time, np.array(joints), np.array([x, 0, 0]), np.eye(3), 0.0, GRID, np.zeros((2, 2))
    )


@pytest.mark.parametrize(
    ("machine", "params"),
    [
        (excavator(), {}),
        (replace(HEADER, tools={}), {}),
        (HEADER, {"width": 6.5}),
        (HEADER, {"width": 1.0}),
        (HEADER, {"height": 0.5}),
        (HEADER, {"height": 6.0}),
        (HEADER, {"head_angular_velocity": 9.0}),
    ],
    ids=["joints", "no drum", "too wide", "too narrow", "too low", "too high", "head speed"],
)
def test_machine_or_face_that_does_not_fit_is_rejected(machine, params) -> None:
    with pytest.raises(MachineError):
        FaceCuttingTask(machine, FaceCuttingParams(**params))


def test_head_speed_beyond_its_limit_is_rejected_with_the_limit() -> None:
    with pytest.raises(MachineError, match=r"head_angular_velocity is 9.* at most 8\.0 rad/s"):
        FaceCuttingTask(HEADER, FaceCuttingParams(head_angular_velocity=9.0))


def test_head_rotates_before_the_machine_drives() -> None:
    task = FaceCuttingTask(HEADER, FaceCuttingParams())
    command = task.command(observation(), DT)
    assert command.joints[2] == FaceCuttingParams().head_angular_velocity
    assert not command.tracks.any()
    assert task.phase == "start"


def test_task_is_aborted_where_there_is_no_face() -> None:
    params = FaceCuttingParams(max_approach_distance=1.0)
    task, geometry = FaceCuttingTask(HEADER, params), FaceGeometry(HEADER, params)
    head, x = 0.0, 0.0
    joints = [geometry.max_turn_angle, geometry.lift_angle(geometry.row_heights[0])]
    for k in range(2000):
        head += params.head_angular_velocity * DT
        command = task.command(observation(k * DT, (*joints, head), x), DT)
        x += float(command.tracks.mean()) * DT
        if task.done:
            break
    assert task.abort_reason
    assert x == pytest.approx(1.0, abs=0.01)
    assert not task.command(observation(99.0, (*joints, head), x), DT).joints.any()


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.parametrize("kind", ["loam", "rock"])
def test_face_is_cut_in_passes(kind: str) -> None:
    x = GRID.x(np.arange(GRID.rows))
    heights, ids = np.zeros(GRID.shape), np.zeros(GRID.shape, np.uint8)
    heights[x > FACE_X], ids[x > FACE_X - 0.2] = 1.8, 1
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
    task = FaceCuttingTask(
        HEADER, FaceCuttingParams(width=2.6, height=1.6, rounds=1, timeout=200.0)
    )
    phases, imbalances, max_torque = set(), set(), 0.0
    operated = OperatedMachine(world, sim.simulated_machines[0], task, sim.params.tick_period)
    while not task.done:
        operated.observe_and_command(DT)
        for _ in range(2):
            imbalances.add(world.step().imbalance)
        phases.add(task.phase)
        max_torque = max(max_torque, sim.machine.joint_efforts[2])
    loss = before - soil.columns.height
    world.close()
    assert task.abort_reason == ""
    assert imbalances == {0}
    assert phases >= {"sump", "slew", "rise", "lower", "back", "done"}
    # The foot of the face is cut over the width of the face, and stands beside it.
    row = int(np.argmin(np.abs(x - FACE_X - 0.1)))
    y = GRID.y(np.arange(GRID.cols))
    assert loss[row, np.abs(y) < 1.0].mean() > 0.8
    assert np.abs(loss[row, np.abs(y) > 4.0]).max() < 0.3
    assert max_torque > 5e3  # of 16.5 kN m; loam takes 10, rock all
