"""Hydraulics: shared flow, limited power, relief valves, locked cylinders, cushions, pressures."""

import math

import numpy as np
import pytest
from numba import njit

from machine_sim.machine import EXCAVATOR_JOINTS
from machine_sim.machine.hydraulic_kernels import advance_supply, limit_speeds, limit_torques
from machine_sim.machine.hydraulics import HydraulicSystem
from machine_sim.machine.joint_table import (
    ANGLE,
    EFFORT,
    IS_HOLDING,
    RATE,
    TARGET_RATE,
    TORQUE_LIMIT,
    joint_table,
)

from .conftest import DT

REST = [0.0] * 4
MOVING = [0.1] * 4
NOT_HELD = [False] * 4
MIDDLE = [0.0, -0.3, 1.5, 0.8]
"""Joint angles far from all limits [rad]."""


class Arm:
    """The hydraulics of an excavator, one kernel at a time."""

    def __init__(self, spec):
        self.system = HydraulicSystem(
            EXCAVATOR_JOINTS, spec.cylinders, spec.motors, spec.tracks.motor, spec.supply
        )
        self.joints = joint_table([spec.joints[name] for name in EXCAVATOR_JOINTS])
        self.tables = (
            self.system.cylinder_table,
            self.system.motor_table,
            self.system.supply_table,
        )

    def attainable_speeds(self, speeds, angles, efforts, track_speeds=(0.0, 0.0)):
        """Return the attainable speeds of joints [rad/s] and tracks [m/s]."""
        self.joints[ANGLE], self.joints[EFFORT] = angles, efforts
        demand, attainable, tracks = np.array([*speeds, *track_speeds]), np.zeros(4), np.zeros(2)
        _limit_speeds(demand, self.joints, *self.tables, attainable, tracks)
        return attainable.tolist(), tracks.tolist()

    def advance(self, dt, track_forces):
        """Advance engine and travel motors."""
        _advance_supply(dt, np.array(track_forces), self.system.supply_table)

    def torque_limits(self, dt, target_rates, is_holding, angles, rates, efforts):
        """Return the maximum torques of the joints [N m]."""
        joints = self.joints
        joints[ANGLE], joints[RATE], joints[EFFORT] = angles, rates, efforts
        joints[TARGET_RATE], joints[IS_HOLDING] = target_rates, is_holding
        _limit_torques(dt, joints, *self.tables)
        return joints[TORQUE_LIMIT].tolist()


@njit
def _limit_speeds(*arguments):
    limit_speeds(*arguments)


@njit
def _advance_supply(*arguments):
    advance_supply(*arguments)


@njit
def _limit_torques(*arguments):
    limit_torques(*arguments)


@pytest.fixture
def arm(spec):
    return Arm(spec)


def flow(spec, angles, speeds):
    """Return the flow into the cylinders at given joint speeds [m^3/s]."""
    total = 0.0
    for name, cylinder in spec.cylinders.items():
        i = EXCAVATOR_JOINTS.index(name)
        speed = cylinder.linkage.lever_arm(angles[i]) * speeds[i]
        total += abs(speed) * (cylinder.cap_side_area if speed > 0.0 else cylinder.rod_side_area)
    return total + spec.motors["swing"].displacement * abs(speeds[0])


def test_small_flow_demand_is_met(arm):
    joints, tracks = arm.attainable_speeds([0.1, -0.1, 0.0, 0.0], MIDDLE, REST, [0.2, -0.1])
    assert joints == pytest.approx([0.1, -0.1, 0, 0])
    assert tracks == [0.2, -0.1]


def test_large_flow_demand_is_shared_in_proportion_with_the_swing(arm, spec):
    commanded = [1.1, -0.4, 0.5, 0.5]
    attainable, _ = arm.attainable_speeds(commanded, MIDDLE, REST)
    shares = [a / b for a, b in zip(attainable, commanded, strict=True)]
    assert shares == pytest.approx([shares[0]] * 4)
    assert shares[0] < 0.6
    assert flow(spec, MIDDLE, attainable) == pytest.approx(spec.supply.pump_flow)


def test_travel_and_arm_share_the_flow(arm, spec):
    commanded = [0.0, -0.3, 0.5, 0.0]
    alone, _ = arm.attainable_speeds(commanded, MIDDLE, REST)
    joints, tracks = arm.attainable_speeds(commanded, MIDDLE, REST, [1.5, 1.2])
    travel_flow = spec.tracks.motor.min_displacement * sum(tracks)
    assert joints[2] < 0.75 * alone[2]
    assert tracks[0] / 1.5 == pytest.approx(joints[2] / 0.5)
    assert flow(spec, MIDDLE, joints) + travel_flow == pytest.approx(spec.supply.pump_flow)


def test_travel_motor_takes_more_oil_at_a_large_force(arm, spec):
    motor, effort = spec.tracks.motor, spec.tracks.max_tractive_effort
    _, fast = arm.attainable_speeds(REST, MIDDLE, REST, [1.5, 1.5])
    for _ in range(1000):
        arm.advance(DT, [effort, effort])
    _, strong = arm.attainable_speeds(REST, MIDDLE, REST, [1.5, 1.5])
    pressure = motor.relief_pressure
    assert fast == pytest.approx([1.5, 1.5])
    power = 2.0 * strong[0] * effort * pressure / (pressure - spec.supply.return_pressure)
    assert power == pytest.approx(spec.supply.pump_power)


def test_cylinder_of_one_pump_takes_no_more_than_its_flow(arm, spec):
    speeds, _ = arm.attainable_speeds([0.0, 0.0, 0.0, 1.8], MIDDLE, REST)
    assert flow(spec, MIDDLE, speeds) == pytest.approx(spec.cylinders["bucket"].max_flow)


def test_engine_droops_under_load_and_recovers(arm, spec):
    supply, boom = spec.supply, spec.cylinders["boom"]
    torque = boom.linkage.lever_arm(MIDDLE[1]) * boom.force_limit(20e6, 0.5e6, is_extending=True)
    start = flow(spec, MIDDLE, arm.attainable_speeds([0, -0.8, 0, 0], MIDDLE, REST)[0])
    for _ in range(1000):
        arm.attainable_speeds([0, -0.8, 0, 0], MIDDLE, [0.0, torque, 0.0, 0.0])
        arm.advance(DT, [0.0, 0.0])
    load = supply.pump_power / supply.engine_power
    assert arm.system.engine_speed == pytest.approx(1.0 - supply.engine_droop * load, rel=1e-3)
    loaded = flow(spec, MIDDLE, arm.attainable_speeds([0, -0.8, 0, 0], MIDDLE, REST)[0])
    assert loaded == pytest.approx(arm.system.engine_speed * start)
    for _ in range(1000):
        arm.attainable_speeds(REST, MIDDLE, REST)
        arm.advance(DT, [0.0, 0.0])
    assert arm.system.engine_speed == pytest.approx(1.0, abs=1e-3)


def test_flow_at_high_pressure_is_limited_by_power(arm, spec):
    supply, boom = spec.supply, spec.cylinders["boom"]
    lever_arm = boom.linkage.lever_arm(MIDDLE[1])
    pressure = 30e6
    force = pressure * boom.cap_side_area - supply.return_pressure * boom.rod_side_area
    attainable, _ = arm.attainable_speeds([0, -0.45, 0, 0], MIDDLE, [0, lever_arm * force, 0, 0])
    total_flow = flow(spec, MIDDLE, attainable)
    assert total_flow * pressure == pytest.approx(supply.pump_power)
    assert total_flow < supply.pump_flow


def test_cushion_reduces_speed_toward_the_end_only(arm, spec):
    linkage = spec.cylinders["arm"].linkage
    near = [0.0, -0.3, linkage.angle(linkage.max_length - 0.01), 0.8]
    toward = arm.attainable_speeds([0, 0, 0.2, 0], near, REST)[0][2]
    away = arm.attainable_speeds([0, 0, -0.2, 0], near, REST)[0][2]
    assert 0.02 < toward < 0.1
    assert away == pytest.approx(-0.2)


def test_torque_limit_follows_lever_arm_area_and_direction(arm, spec):
    supply, boom = spec.supply, spec.cylinders["boom"]
    for angle in (-1.0, -0.3, 0.5):
        angles = [0.0, angle, 1.5, 0.8]
        lever_arm = boom.linkage.lever_arm(angle)
        lifting = [0.0, math.copysign(1e5, lever_arm), 0.0, 0.0]
        push = arm.torque_limits(DT, MOVING, NOT_HELD, angles, REST, lifting)[1]
        pull = arm.torque_limits(DT, MOVING, NOT_HELD, angles, REST, [-e for e in lifting])[1]
        cap, rod, back = boom.cap_side_area, boom.rod_side_area, supply.return_pressure
        assert push == pytest.approx(
            abs(lever_arm) * (supply.main_relief_pressure * cap - back * rod)
        )
        assert pull == pytest.approx(
            abs(lever_arm) * (supply.main_relief_pressure * rod - back * cap)
        )
        locked = arm.torque_limits(DT, REST, NOT_HELD, angles, REST, lifting)[1]
        assert locked == pytest.approx(
            abs(lever_arm) * (supply.port_relief_pressure * cap - back * rod)
        )


def test_pressures_balance_the_force(arm, spec):
    for effort in (-2e5, -1e3, 0.0, 1e3, 2e5):
        efforts = [0.0, effort, effort, 0.3 * effort]
        for name, state in arm.system.states(MIDDLE, [0.1] * 4, efforts).items():
            cylinder = spec.cylinders[name]
            force = (
                state.cap_side_pressure * cylinder.cap_side_area
                - state.rod_side_pressure * cylinder.rod_side_area
            )
            lever_arm = cylinder.linkage.lever_arm(MIDDLE[EXCAVATOR_JOINTS.index(name)])
            assert state.force == pytest.approx(efforts[EXCAVATOR_JOINTS.index(name)] / lever_arm)
            assert force == pytest.approx(state.force, abs=1e-6)
            assert min(state.cap_side_pressure, state.rod_side_pressure) == pytest.approx(
                spec.supply.return_pressure
            )
            assert state.speed == pytest.approx(0.1 * lever_arm)


def test_arm_stalls_at_the_relief_pressure(scene, spec):
    s = scene()
    s.run(0.5)
    before = s.machine.joint_positions[2]
    s.machine.command([0.0, 0.0, 0.5, 0.0], [0.0, 0.0])
    for _ in range(200):
        # Far above the breakout force of the arm.
        _, origin = s.machine.tool.pose
        s.machine.tool.push([4e5, 0.0, 0.0], [0.0] * 3, origin)
        s.step()
    state = s.machine.cylinders["arm"]
    assert s.machine.joint_positions[2] < before + 0.02
    assert state.cap_side_pressure == pytest.approx(spec.supply.main_relief_pressure, rel=0.08)


def test_boom_at_rest_is_held_by_cap_side_pressure(scene, spec):
    s = scene()
    s.run(2.0)
    start = s.machine.joint_positions
    s.run(5.0)
    assert np.abs(s.machine.joint_positions - start).max() < 1e-5
    boom = s.machine.cylinders["boom"]
    assert boom.force > 0.0
    assert 2e6 < boom.cap_side_pressure < 25e6


def test_arm_is_slower_while_boom_and_bucket_move(scene):
    def arm_angle_after_half_a_second(velocities):
        s = scene()
        s.run(0.3)
        s.machine.command(velocities, [0.0, 0.0])
        start = s.machine.joint_positions[2]
        s.run(100 * DT)
        return s.machine.joint_positions[2] - start

    combined = arm_angle_after_half_a_second([1.2, -0.8, 1.0, -1.0])
    alone = arm_angle_after_half_a_second([0.0, 0.0, 1.0, 0.0])
    assert combined < 0.75 * alone
