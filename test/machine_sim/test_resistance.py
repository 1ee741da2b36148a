"""What the soil's wrench does to a tool: it resists, it stalls, and it never drives."""

import numpy as np
import pytest
from support.machine_scenes import level_soil, machine_on_level_ground

from earthmoving_sim.world import World
from machine_sim.core import MachineSim
from machine_sim.machine import MachineError
from machine_sim.resistance import LAPSE, Resistance
from msg_bridge.contract.rows import CHANGED, CONVERSION, FORCE, Rows, empty_rows

DT = 0.005
REST = (np.eye(3), np.zeros(3))


def forces(fx: float = 0.0, point: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Rows:
    rows = empty_rows(FORCE, 1)
    rows["x"], rows["y"], rows["z"] = point
    rows["fx"] = fx
    return rows


def pushed(resistance: Resistance, speed: float, steps: int) -> float:
    """Force along x [N] after some steps at a speed [m/s]."""
    for _ in range(steps):
        force, _ = resistance.step(REST, (np.array([speed, 0.0, 0.0]), np.zeros(3)), DT)
    return float(force[0])


def lip(machine: MachineSim) -> np.ndarray:
    rotation, origin = machine.machine.tool_pose
    return origin + rotation @ np.array([1.45, 0.0, 0.0])


def swung(machine: MachineSim, against: float | None, ticks: int) -> list[float]:
    """y of the lip [m] of a machine that swings left, against a force along y [N]."""
    machine.command(np.array([0.3, 0, 0, 0]), np.zeros(2))
    way = []
    for _ in range(ticks):
        machine.step()
        rows = empty_rows(FORCE, 1)
        rows["x"], rows["y"], rows["z"] = lip(machine)
        rows["fy"] = against or 0.0
        machine.apply(empty_rows(CONVERSION), empty_rows(CHANGED), rows)
        way.append(float(lip(machine)[1]))
    return way


def test_a_tool_that_cuts_feels_all_of_the_force() -> None:
    resistance = Resistance(800.0, DT)
    resistance.hear(forces(-20e3)[0], REST)
    assert pushed(resistance, 0.5, 20) == pytest.approx(-20e3)
    assert resistance.share == 1.0


def test_soil_does_not_push_a_tool_at_rest_or_on_its_way_back() -> None:
    resistance = Resistance(800.0, DT)
    resistance.hear(forces(-20e3)[0], REST)
    assert pushed(resistance, 0.0, 10) == 0.0
    assert pushed(resistance, -0.5, 10) == 0.0


def test_a_tool_at_rest_stays_held_and_one_that_left_is_let_go() -> None:
    resistance = Resistance(800.0, DT)
    resistance.hear(forces(-20e3)[0], REST)
    for _ in range(10 * LAPSE):
        resistance.tick()
        resistance.hear(forces()[0], REST)
    assert resistance.holds
    resistance.hear(forces()[0], (np.eye(3), np.array([0.0, 0.0, 0.1])))
    assert not resistance.holds


def test_a_wrench_lapses_when_nothing_more_is_heard() -> None:
    resistance = Resistance(800.0, DT)
    resistance.hear(forces(-20e3)[0], REST)
    for _ in range(LAPSE):
        resistance.tick()
    assert resistance.holds
    resistance.tick()
    assert not resistance.holds


def test_a_wrench_that_is_not_finite_is_refused() -> None:
    resistance = Resistance(800.0, DT)
    with pytest.raises(MachineError, match="finite metres"):
        resistance.hear(forces(np.nan)[0], REST)
    assert not resistance.holds


def test_more_than_the_machine_can_push_stalls_it_and_does_not_push_it_back() -> None:
    free, stalled = machine_on_level_ground(), machine_on_level_ground()
    assert swung(free, None, 150)[-1] > 1.0
    way = swung(stalled, -500e3, 150)  # its swing drive pushes some 50 kN
    assert way[-1] < 0.3
    assert min(way) > -0.01
    assert max(way[75:]) - min(way[75:]) < 0.05
    assert stalled.tool_wrench[0][1] < -10e3
    free.close()
    stalled.close()


def test_digging_in_clay_is_felt_and_repeatable() -> None:
    found = []
    for _ in range(2):
        soil = level_soil(soil="dry clay")
        machine = machine_on_level_ground(swell=soil.kinds[0].swell)
        world = World(soil, {1: machine})
        felt = 0.0
        for joints, ticks in (([0, 0.4, -0.4, -0.5], 150), ([0, 0.4, 0.3, 0], 20)):
            machine.command(np.array(joints, dtype=np.float64), np.zeros(2))
            for _ in range(ticks):
                world.step()
                felt = max(felt, float(np.abs(machine.tool_wrench[0]).max()))
        found.append((machine.state_hash(), felt))
        machine.close()
    assert found[0] == found[1]
    assert found[0][1] > 1e3
