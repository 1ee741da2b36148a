"""Soil resistance: it resists and stalls a tool, and never drives it."""

import numpy as np
import pytest
from support.machine_scenes import (
    GRID,
    level_soil,
    loose_soil_options,
    machine_on_level_ground,
)
from support.soil_scenes import reference_soil

from earthmoving_sim.world import World
from machine_sim.machine import MachineError
from machine_sim.simulation import MachineSim
from machine_sim.tool_soil.capped_spring_damper import ACTIVE_FRACTION
from machine_sim.tool_soil.resistance import FORCE_TIMEOUT_TICKS, SoilResistance
from msg_bridge.contract.rows import CONVERSION, FORCE, MAP_UPDATE, Rows, SoilReaction, empty_rows
from soil_sim.soil import Soil

DT = 0.005
REST = (np.eye(3), np.zeros(3))
STILL = (0.0, 0.0, 0.0)


def forces(fx: float = 0.0, point: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Rows:
    rows = empty_rows(FORCE, 1)
    rows["x"], rows["y"], rows["z"] = point
    rows["fx"] = fx
    return rows


def force_after_steps(resistance: SoilResistance, speed: float, steps: int) -> float:
    """Return the force along x [N] after some steps at a speed [m/s]."""
    for _ in range(steps):
        force, _ = resistance.step(REST, ((speed, 0.0, 0.0), STILL), DT)
    return float(force[0])


def lip(machine: MachineSim) -> np.ndarray:
    rotation, origin = machine.machine.tool.pose
    return origin + rotation @ np.array([1.45, 0.0, 0.0])


def swing_against_force(machine: MachineSim, force: float | None, ticks: int) -> list[float]:
    """Return y of the lip after each tick [m], of a machine that swings against a force [N]."""
    machine.command(np.array([0.3, 0, 0, 0]), np.zeros(2))
    path = []
    for _ in range(ticks):
        machine.step()
        rows = empty_rows(FORCE, 1)
        rows["x"], rows["y"], rows["z"] = lip(machine)
        rows["fy"] = force or 0.0
        machine.apply(empty_rows(CONVERSION), empty_rows(MAP_UPDATE), rows)
        path.append(float(lip(machine)[1]))
    return path


def test_cutting_tool_has_the_whole_force() -> None:
    resistance = SoilResistance(800.0, 20e3, DT)
    resistance.receive(forces(-20e3), REST)
    assert force_after_steps(resistance, 0.5, 20) == pytest.approx(-20e3)
    assert resistance.spring_dampers[0, ACTIVE_FRACTION] == 1.0


def test_soil_in_the_tool_transmits_a_part_of_the_resistance() -> None:
    def force_with(push: float) -> float:
        resistance = SoilResistance(800.0, 20e3, DT)
        resistance.receive(forces(-20e3), REST)
        forward = (0.5, 0.0, 0.0), STILL
        for _ in range(200):
            force, _ = resistance.step(REST, forward, DT, (push, 3e3, -5e3))
        return float(force[0])

    assert force_with(-8e3) == pytest.approx(-12e3, rel=1e-3)
    assert force_with(-30e3) == 0.0
    assert force_with(8e3) == pytest.approx(-20e3), "soil that pushes forward"


def test_soil_enters_until_the_soil_in_the_tool_pushes_as_the_soil_ahead_resists() -> None:
    def inflow_with(push: float) -> float:
        resistance = SoilResistance(800.0, 20e3, DT)
        resistance.receive(forces(-20e3), REST)
        for _ in range(400):
            resistance.step(REST, ((0.5, 0.0, 0.0), STILL), DT, (push, 9e3, 0.0))
        return resistance.inflow_fraction

    assert SoilResistance(800.0, 20e3, DT).inflow_fraction == 1.0, "nothing resists"
    assert inflow_with(0.0) == inflow_with(-15.9e3) == inflow_with(30e3) == 1.0
    assert inflow_with(-18e3) == pytest.approx(0.5, abs=0.01)
    assert inflow_with(-25e3) == 0.0


def test_soil_does_not_push_a_tool_at_rest_or_moving_back() -> None:
    resistance = SoilResistance(800.0, 20e3, DT)
    resistance.receive(forces(-20e3), REST)
    assert force_after_steps(resistance, 0.0, 10) == 0.0
    assert force_after_steps(resistance, -0.5, 10) == 0.0


def test_wrench_stays_at_rest_and_ends_at_the_release_distance() -> None:
    resistance = SoilResistance(800.0, 20e3, DT)
    resistance.receive(forces(-20e3), REST)
    for _ in range(10 * FORCE_TIMEOUT_TICKS):
        resistance.begin_tick()
        resistance.receive(forces(), REST)
    assert resistance.is_active
    resistance.receive(forces(), (np.eye(3), np.array([0.0, 0.0, 0.1])))
    assert not resistance.is_active


def test_wrench_expires_without_force_rows() -> None:
    resistance = SoilResistance(800.0, 20e3, DT)
    resistance.receive(forces(-20e3), REST)
    for _ in range(FORCE_TIMEOUT_TICKS):
        resistance.begin_tick()
    assert resistance.is_active
    resistance.begin_tick()
    assert not resistance.is_active


def test_wrench_that_is_not_finite_is_rejected() -> None:
    resistance = SoilResistance(800.0, 20e3, DT)
    with pytest.raises(MachineError, match="finite"):
        resistance.receive(forces(np.nan), REST)
    assert not resistance.is_active


def test_force_above_the_drive_stalls_the_swing_and_does_not_push_it_back() -> None:
    free, stalled = machine_on_level_ground(), machine_on_level_ground()
    assert swing_against_force(free, None, 150)[-1] > 1.0
    way = swing_against_force(stalled, -500e3, 150)  # its swing drive pushes some 50 kN
    assert way[-1] < 0.3
    assert min(way) > -0.01
    assert max(way[75:]) - min(way[75:]) < 0.05
    assert stalled.tool_coupling.wrench[0][1] < -10e3
    free.close()
    stalled.close()


def test_digging_in_clay_is_resisted_and_reproducible() -> None:
    found = []
    for _ in range(2):
        soil = level_soil(soil="dry clay")
        machine = machine_on_level_ground(**loose_soil_options(soil))
        world = World(soil, {1: machine})
        felt = 0.0
        for joints, ticks in (([0, 0.4, -0.4, -0.5], 150), ([0, 0.4, 0.3, 0], 20)):
            machine.command(np.array(joints, dtype=np.float64), np.zeros(2))
            for _ in range(ticks):
                world.step()
                felt = max(felt, float(np.abs(machine.tool_coupling.wrench[0]).max()))
        found.append((machine.state_hash(), felt))
        machine.close()
    assert found[0] == found[1]
    assert found[0][1] > 1e3


def bearing(fz: float) -> Rows:
    rows = empty_rows(FORCE, 2)
    rows["reaction"] = (SoilReaction.CUT, SoilReaction.BEARING)
    rows["fz"] = (0.0, fz)
    return rows


def test_bearing_reaction_supports_a_tool_until_it_is_lifted() -> None:
    resistance = SoilResistance(800.0, 20e3, DT)
    resistance.receive(bearing(300e3), REST)
    down = ((0.0, 0.0, -0.01), STILL)
    force, _ = resistance.step(REST, down, DT)
    assert 0.0 < force[2] < 300e3
    assert resistance.step(REST, ((0.0, 0.0, 0.01), STILL), DT)[0][2] == 0.0
    resistance.receive(bearing(0.0), (np.eye(3), np.array([0.0, 0.0, 0.02])))
    assert resistance.is_active, "it may have bounced"
    resistance.receive(bearing(0.0), (np.eye(3), np.array([0.0, 0.0, 0.1])))
    assert not resistance.is_active


def test_bearing_reaction_is_limited_to_its_maximum() -> None:
    resistance = SoilResistance(800.0, 20e3, DT)
    resistance.receive(bearing(50e3), REST)
    for _ in range(20):
        force, _ = resistance.step(REST, ((0.0, 0.0, -0.5), STILL), DT)
    assert force[2] == pytest.approx(50e3)


def test_machine_stands_on_its_bucket() -> None:
    """Boom down lifts the tracks' front; then nothing moves for two seconds."""
    soil = level_soil(soil="loam")
    machine = machine_on_level_ground(**loose_soil_options(soil))
    world = World(soil, {1: machine})
    heights = []
    for boom, ticks in ((0.35, 260), (0.0, 400)):
        machine.command(np.array([0.0, boom, 0.0, 0.0]), np.zeros(2))
        for _ in range(ticks):
            world.step()
            heights.append(float(machine.machine.base_pose[0][2]))
    machine.close()
    assert heights[-1] > 0.2
    assert max(heights[-200:]) - min(heights[-200:]) < 0.02


def move_joints(
    soil: Soil, *strokes: tuple[list[float], int]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return lip and base [m] after each stroke of joint velocities and a number of ticks."""
    machine = machine_on_level_ground(**loose_soil_options(soil))
    world = World(soil, {1: machine})
    positions = []
    for joints, ticks in strokes:
        machine.command(np.array(joints, dtype=np.float64), np.zeros(2))
        for _ in range(ticks):
            world.step()
        positions.append((lip(machine), np.array(machine.machine.base_pose[0])))
    machine.close()
    return positions


@pytest.mark.parametrize("name", ["loam", "rock"])
def test_bucket_pushed_down_on_its_back_lifts_the_machine(name) -> None:
    (tip, base), *_ = move_joints(level_soil(soil=name), ([0, 0.3, -0.3, -0.5], 250))
    assert tip[2] > -0.2  # not pushed into the ground
    assert base[2] > 0.15


def test_bucket_that_swings_against_a_bank_of_rock_turns_the_machine() -> None:
    heights = np.zeros(GRID.shape)
    heights[np.ix_(GRID.x(np.arange(GRID.rows)) > 3.0, GRID.y(np.arange(GRID.cols)) > 0.7)] = 0.6
    into = ([0, 0.3, -0.1, -0.3], 200)
    swing = ([0.4, 0, 0, 0], 150)
    for name, held in (("rock", True), ("reference", False)):
        soil = Soil(GRID, heights, reference_soil(soil=name))
        (before, stood), (after, stands) = move_joints(soil, into, swing)
        assert (abs(after[1] - before[1]) < 0.1) == held
        assert abs(stands[1] - stood[1]) > 0.08
