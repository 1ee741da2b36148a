"""Going to an angle: there without overshoot, the shorter way, and the same for the same state."""

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
    "swing": JointLimits(-math.inf, math.inf, 1.0, 1.1, 1.5),
    "boom": JointLimits(-1.05, 0.85, 1.0, 0.45, 1.5),
    "arm": JointLimits(0.55, 2.6, 1.0, 1.1, 3.0),
}


def run(limits, start, goal, tick, seconds=12.0):
    """Angles at each tick of a joint that follows its reference, commanded once a tick."""
    reference = JointReference([limits], np.array([start]))
    angles = [start]
    for _ in range(round(seconds / tick)):
        reference.command = [velocity_to_target(goal, angles[-1], limits)]
        for _ in range(round(tick / PHYSICS_STEP)):
            reference.advance(PHYSICS_STEP, reference.angle)
        angles.append(reference.angle[0])
    return np.array(angles)


def part(limits, fraction):
    if math.isinf(limits.upper):
        return (fraction - 0.5) * 2.0 * math.pi
    return limits.lower + fraction * (limits.upper - limits.lower)


@pytest.mark.parametrize("name", LIMITS)
@settings(max_examples=25, deadline=None)
@given(start=st.floats(0.0, 1.0), goal=st.floats(0.0, 1.0), tick=st.sampled_from([0.01, 0.05]))
def test_joint_arrives_without_overshoot_and_stays(name, start, goal, tick):
    limits = LIMITS[name]
    start, goal = part(limits, start), part(limits, goal)
    way = goal - start
    if math.isinf(limits.upper):
        way = math.remainder(way, 2.0 * math.pi)
    gone = (run(limits, start, goal, tick) - start) * math.copysign(1.0, way)
    assert gone.max() <= abs(way) + POSITION_TOLERANCE
    assert gone[-1] == pytest.approx(abs(way), abs=2.0 * POSITION_TOLERANCE)
    assert np.ptp(gone[-10:]) == 0.0


def test_joint_there_is_told_nothing():
    limits = LIMITS["boom"]
    assert velocity_to_target(0.2, 0.2 + 0.9 * POSITION_TOLERANCE, limits) == 0.0
    assert velocity_to_target(0.2, 0.2 - 1.1 * POSITION_TOLERANCE, limits) > 0.0


def test_far_from_its_goal_a_joint_goes_at_top_speed():
    for limits in LIMITS.values():
        assert velocity_to_target(2.5, 0.0, limits) == limits.max_velocity
        assert velocity_to_target(0.0, 2.5, limits) == -limits.max_velocity


@pytest.mark.parametrize(
    ("goal", "angle", "direction"),
    [(3.0, -3.0, -1), (-3.0, 3.0, 1), (0.5, 12.0, 1), (1.0, 0.0, 1), (-1.0, 0.0, -1)],
)
def test_swing_takes_the_shorter_way_around(goal, angle, direction):
    assert velocity_to_target(goal, angle, LIMITS["swing"]) * direction > 0.0


def test_swing_is_there_a_whole_turn_on():
    assert velocity_to_target(1.0, 1.0 + 4.0 * math.pi, LIMITS["swing"]) == 0.0


def test_only_a_joint_without_limits_wraps():
    assert velocity_to_target(2.5, -2.5, LIMITS["boom"]) > 0.0


def test_board_brings_each_joint_to_its_angle(arbiter, spec):
    goal = np.array([-2.5, 0.3, 1.0, 0.4])
    limits = [spec.joints[name] for name in EXCAVATOR_JOINTS]
    reference, b = JointReference(limits, spec.home), arbiter()
    for tick in range(1000):
        now = 0.01 * tick
        if tick % 20 == 0:
            b.joints(EXCAVATOR_JOINTS, [], goal, now)
        reference.command = b.command_at(now, reference.angle).joints.tolist()
        for _ in range(2):
            reference.advance(PHYSICS_STEP, reference.angle)
    assert np.abs(np.array(reference.angle) - goal).max() <= 2.0 * POSITION_TOLERANCE
    assert b.command_at(10.0, reference.angle).joints.tolist() == [0.0] * 4
