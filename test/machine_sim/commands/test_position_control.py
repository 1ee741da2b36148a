"""Position control: no overshoot, the shorter direction, and a function of the state alone."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from machine_sim.commands.position_control import POSITION_TOLERANCE, velocity_to_target
from machine_sim.machine import EXCAVATOR_JOINTS, JointLimits
from machine_sim.machine.joint_reference import JointReference

PHYSICS_STEP = 0.005
LIMITS = {
    "swing": JointLimits(-math.inf, math.inf, 1.0, 1.1, 1.5, 1.5),
    "boom": JointLimits(-1.05, 0.85, 1.0, 0.45, 1.5, 1.5),
    "arm": JointLimits(0.55, 2.6, 1.0, 1.1, 3.0, 3.0),
}


def run(limits, start, goal, tick, seconds=12.0):
    """Return the angle at each tick of a joint that follows its reference."""
    reference = JointReference([limits], np.array([start]))
    angles = [start]
    for _ in range(round(seconds / tick)):
        reference.command = [velocity_to_target(goal, angles[-1], limits)]
        for _ in range(round(tick / PHYSICS_STEP)):
            reference.advance(PHYSICS_STEP, reference.angle, reference.rate)
        angles.append(reference.angle[0])
    return np.array(angles)


def part(limits, fraction):
    if math.isinf(limits.upper):
        return (fraction - 0.5) * 2.0 * math.pi
    return limits.lower + fraction * (limits.upper - limits.lower)


@pytest.mark.parametrize("name", LIMITS)
@settings(max_examples=25, deadline=None)
@given(start=st.floats(0.0, 1.0), goal=st.floats(0.0, 1.0), tick=st.sampled_from([0.01, 0.05]))
def test_joint_reaches_its_target_without_overshoot(name, start, goal, tick):
    limits = LIMITS[name]
    start, goal = part(limits, start), part(limits, goal)
    way = goal - start
    if math.isinf(limits.upper):
        way = math.remainder(way, 2.0 * math.pi)
    gone = (run(limits, start, goal, tick) - start) * math.copysign(1.0, way)
    assert gone.max() <= abs(way) + POSITION_TOLERANCE
    assert gone[-1] == pytest.approx(abs(way), abs=2.0 * POSITION_TOLERANCE)
    assert np.ptp(gone[-10:]) == 0.0


def test_velocity_at_the_target_is_zero():
    limits = LIMITS["boom"]
    assert velocity_to_target(0.2, 0.2 + 0.9 * POSITION_TOLERANCE, limits) == 0.0
    assert velocity_to_target(0.2, 0.2 - 1.1 * POSITION_TOLERANCE, limits) > 0.0


def test_velocity_far_from_the_target_is_the_maximum():
    for limits in LIMITS.values():
        assert velocity_to_target(2.5, 0.0, limits) == limits.max_velocity
        assert velocity_to_target(0.0, 2.5, limits) == -limits.max_velocity


@pytest.mark.parametrize(
    ("goal", "angle", "direction"),
    [(3.0, -3.0, -1), (-3.0, 3.0, 1), (0.5, 12.0, 1), (1.0, 0.0, 1), (-1.0, 0.0, -1)],
)
def test_swing_turns_in_the_shorter_direction(goal, angle, direction):
    assert velocity_to_target(goal, angle, LIMITS["swing"]) * direction > 0.0


def test_target_of_swing_is_modulo_one_turn():
    assert velocity_to_target(1.0, 1.0 + 4.0 * math.pi, LIMITS["swing"]) == 0.0


def test_only_a_continuous_joint_wraps():
    assert velocity_to_target(2.5, -2.5, LIMITS["boom"]) > 0.0


def test_arbiter_moves_each_joint_to_its_target(make_arbiter, spec):
    goal = np.array([-2.5, 0.3, 1.0, 0.4])
    limits = [spec.joints[name] for name in EXCAVATOR_JOINTS]
    reference, arbiter = JointReference(limits, spec.home), make_arbiter()
    for tick in range(1000):
        now = 0.01 * tick
        if tick % 20 == 0:
            arbiter.receive_joints(EXCAVATOR_JOINTS, [], goal, now)
        reference.command = arbiter.command_at(now, reference.angle).joints.tolist()
        for _ in range(2):
            reference.advance(PHYSICS_STEP, reference.angle, reference.rate)
    assert np.abs(np.array(reference.angle) - goal).max() <= 2.0 * POSITION_TOLERANCE
    assert arbiter.command_at(10.0, reference.angle).joints.tolist() == [0.0] * 4
