"""Swing with a hydraulic motor: torque limit, soft brake, holding, and its effect on the base."""

import math
from dataclasses import replace

import numpy as np
import pytest

from .conftest import DT

STILL = [0.0, 0.0]
FULL = 1.22
"""Swing velocity at full lever [rad/s]."""
CARRYING = (-0.55, 1.7, 1.4)
"""Angles of boom, arm and bucket that carry a load near the ground [rad]."""
REACHING = (-0.35, 0.65, 0.9)
"""Angles of boom, arm and bucket at nearly full reach [rad]."""


@pytest.fixture
def with_arm(spec):
    """Return a function that returns the excavator with initial arm angles and motor values."""

    def make(angles, **motor):
        home = np.array([0.0, *angles])
        home.setflags(write=False)
        return replace(spec, home=home, motors={"swing": replace(spec.motors["swing"], **motor)})

    return make


def swing_and_release(s, angle):
    """Swing at full lever over an angle [rad], then release the lever and wait for rest.

    Returns:
        Time until rest [s].
    """
    start, seconds = s.machine.joint_positions[0], 0.0
    s.machine.command([math.copysign(FULL, angle), 0.0, 0.0, 0.0], STILL)
    while abs(s.machine.joint_positions[0] - start) < abs(angle) and seconds < 10.0:
        s.step()
        seconds += DT
    s.machine.command([0.0] * 4, STILL)
    while abs(s.machine.joint_velocities[0]) > 0.01 and seconds < 10.0:
        s.step()
        seconds += DT
    return seconds


@pytest.mark.parametrize("arm", [CARRYING, REACHING])
def test_ten_full_lever_swings_do_not_move_the_base(scene, with_arm, arm):
    s = scene(machine=with_arm(arm))
    s.run(1.0)
    start, heading = s.position, s.machine.base_frame[0]
    for k in range(10):
        swing_and_release(s, (-1.0) ** k * math.pi / 2)
        s.run(0.3)
    turned = heading.T @ s.machine.base_frame[0]
    assert np.linalg.norm((s.position - start)[:2]) < 0.05
    assert abs(math.degrees(math.atan2(turned[1, 0], turned[0, 0]))) < 1.0


def test_torque_never_exceeds_the_relief_pressure(scene, spec):
    s = scene()
    s.run(0.5)
    efforts = []
    for velocity in (FULL, -FULL, 0.0):
        s.machine.command([velocity, 0.0, 0.0, 0.0], STILL)
        for _ in range(round(1.5 / DT)):
            s.step()
            if abs(s.machine.joint_velocities[0]) > 0.02:  # at rest the parking brake holds
                efforts.append(abs(s.machine.joint_efforts[0]))
    limit = spec.motors["swing"].max_torque(spec.supply.return_pressure)
    assert 0.98 * limit < max(efforts) <= limit + 1.0
    assert limit == pytest.approx(80e3, rel=0.01)


def test_torque_rises_within_the_rise_time(scene, spec, with_arm):
    def torque_of_a_swing(rise_time):
        s = scene(machine=with_arm(CARRYING, pressure_rise_time=rise_time))
        s.run(0.5)
        s.machine.command([FULL, 0.0, 0.0, 0.0], STILL)
        s.run(0.2)
        return s.machine.joint_efforts[0]

    slow, fast = torque_of_a_swing(0.4), torque_of_a_swing(0.05)
    assert slow == pytest.approx(20e3 * (0.2 - spec.supply.valve_delay) / 0.1, rel=0.2)
    assert fast > 2.5 * slow


def test_lower_brake_pressure_lengthens_the_run_on(scene, with_arm):
    def run_on(**motor):
        s = scene(machine=with_arm(CARRYING, **motor))
        s.run(0.5)
        swing_and_release(s, math.pi / 2)
        return s.machine.joint_positions[0] - math.pi / 2

    firm, soft = run_on(), run_on(brake_relief_pressure=14e6)
    assert 0.5 < firm < 1.3
    assert soft > 1.4 * firm


def test_released_lever_brakes_at_once_during_the_acceleration(scene, with_arm):
    s = scene(machine=with_arm(REACHING))
    s.run(0.5)
    s.machine.command([FULL, 0.0, 0.0, 0.0], STILL)
    s.run(0.6)
    s.machine.command([0.0] * 4, STILL)
    s.run(0.15)  # delay and closing of the valve
    rate = s.machine.joint_velocities[0]
    assert 0.2 < rate < 0.8 * FULL
    s.run(0.15)
    assert s.machine.joint_velocities[0] < rate
    assert s.machine.joint_efforts[0] < 0.0


def test_stopped_swing_holds_its_angle_on_a_slope(scene):
    s = scene(slope_deg=12.0, yaw=math.pi / 2)
    s.run(1.0)
    swing_and_release(s, 0.5)
    s.run(0.5)
    start = s.machine.joint_positions[0]
    s.run(5.0)
    assert abs(s.machine.joint_positions[0] - start) < 1e-4
