"""Valves: delay, dead band and opening time; commands within the dead band do not move a joint."""

import math
from dataclasses import replace

import pytest

from machine_sim.machine.valves import Valves

from .conftest import DT

STILL = [0.0, 0.0]


@pytest.fixture
def supply(spec):
    return replace(spec.supply, valve_dead_band=0.1, valve_delay=0.1, valve_opening_time=0.2)


def demands(valves, command, seconds):
    """Return the demanded speed of the first actuator after each step."""
    demanded = []
    for _ in range(round(seconds / DT)):
        valves.advance(DT, command)
        demanded.append(valves.demand[0])
    return demanded


def test_command_arrives_after_the_delay(supply):
    valves = Valves(supply, [1.0], [True])
    valves.advance(DT, [0.0])
    demanded = demands(valves, [0.5], 0.5)
    first = next(k for k, speed in enumerate(demanded) if speed > 0.0)
    assert first * DT == pytest.approx(0.1)
    assert demanded[-1] == 0.5
    # The valve opens fully in 0.2 s, and so by half in 0.1 s.
    done = next(k for k, speed in enumerate(demanded) if speed == 0.5)
    assert (done - first + 1) * DT == pytest.approx(0.1)


def test_short_command_is_delayed_and_not_lost(supply):
    valves = Valves(supply, [1.0], [True])
    demanded = demands(valves, [0.5], 0.05) + demands(valves, [0.0], 0.5)
    assert max(demanded) == pytest.approx(0.05 / 0.2)
    assert demanded[-1] == 0.0


def test_command_within_the_dead_band_keeps_the_valve_closed(supply):
    valves = Valves(supply, [2.0, 2.0], [True, True])
    for _ in range(200):
        valves.advance(DT, [0.19, -0.21])
    assert valves.demand == [0.0, -0.21]


def test_valve_does_not_act_on_a_drive_of_its_own(supply):
    valves = Valves(supply, [1.0], [False])
    valves.advance(DT, [0.01])
    assert valves.demand == [0.01]


@pytest.mark.parametrize("delay", [0.0, 0.2])
def test_joint_moves_after_the_delay_and_reaches_its_speed(scene, spec, delay):
    s = scene(machine=replace(spec, supply=replace(spec.supply, valve_delay=delay)))
    s.run(0.5)
    start = s.machine.joint_positions[2]
    s.machine.command([0.0, 0.0, 0.3, 0.0], STILL)
    s.run(delay)
    assert s.machine.joint_positions[2] - start == pytest.approx(0.0, abs=1e-4)
    s.run(0.5)
    assert s.machine.joint_velocities[2] == pytest.approx(0.3, abs=2e-3)


def test_dead_band_of_the_machine_holds_the_joint(scene, spec):
    s = scene()
    s.run(0.5)
    start = s.machine.joint_positions
    small = 0.9 * spec.supply.valve_dead_band
    s.machine.command([small * joint.max_velocity for joint in spec.joints.values()], STILL)
    s.run(1.0)
    assert math.dist(s.machine.joint_positions, start) < 1e-4
