"""The excavator in pybullet: the arm follows commands and holds; states are reproducible."""

import math

import numpy as np
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient

from machine_sim.machine import MachineError, TrackedMachine, rotation_matrix, tool_pose
from machine_sim.machine.arm_kinematics import arm_geometry
from machine_sim.machine.joint_reference import MAX_REFERENCE_LEAD
from machine_sim.machine.tracks.track_model import TRACK_MODELS

from .conftest import DT

STILL = [0.0, 0.0]


def drive(s, velocities, seconds, tracks=STILL):
    s.machine.command(velocities, tracks)
    s.run(seconds)


def state(machine):
    """Return the state of the machine as one array."""
    return np.concatenate(
        [
            *machine.base_pose,
            *machine.base_velocity,
            machine.joint_positions,
            machine.joint_velocities,
            machine.joint_efforts,
            machine.tool.pose[0].ravel(),
            machine.tool.pose[1],
            *machine.tool.velocity,
            machine.tracks.travel,
            machine.tracks.speed,
            machine.tracks.shoe_loads.ravel(),
        ]
    )


@pytest.mark.parametrize("joint", range(4))
def test_joint_follows_its_commanded_velocity(scene, joint):
    s = scene()
    s.run(0.5)
    command = np.zeros(4)
    command[joint] = 0.3 if joint != 3 else -0.3
    drive(s, command, 1.0)
    max_error = 0.0
    for _ in range(100):
        s.step()
        max_error = max(max_error, np.abs(s.machine.joint_velocities - command).max())
    assert max_error < 2e-3


@pytest.mark.parametrize("tracks", TRACK_MODELS)
def test_arm_holds_while_driving_over_a_sill(scene, tracks):
    def sill(x, y):
        return np.where((x > 3.0) & (x < 3.6), 0.15, 0.0)

    s = scene(sill, tracks=tracks)
    s.run(2.0)
    start = s.machine.joint_positions
    s.machine.command([0.0] * 4, [0.8, 0.8])
    moved, tilt = 0.0, 0.0
    for _ in range(round(7.0 / DT)):
        s.step()
        moved = max(moved, np.abs(s.machine.joint_positions - start).max())
        tilt = max(tilt, s.machine.tilt)
    assert s.position[0] > 4.5
    assert tilt > 0.03  # it has driven over the sill
    assert moved <= 0.25e-3


@pytest.mark.parametrize("sign", [1, -1])
def test_joint_limits_are_reached_and_not_exceeded(scene, spec, sign):
    s = scene()
    limits = [spec.joints[name] for name in ("boom", "arm", "bucket")]
    s.machine.command([0.0, sign, sign, sign], STILL)
    low = high = s.machine.joint_positions[1:]
    for _ in range(round(5.0 / DT)):
        s.step()
        low = np.minimum(low, s.machine.joint_positions[1:])
        high = np.maximum(high, s.machine.joint_positions[1:])
    assert (high <= np.array([limit.upper for limit in limits]) + 1e-3).all()
    assert (low >= np.array([limit.lower for limit in limits]) - 1e-3).all()
    ends = [limit.upper if sign > 0 else limit.lower for limit in limits]
    np.testing.assert_allclose(s.machine.joint_positions[1:], ends, atol=1e-3)


def test_mapping_command_moves_named_joints_and_holds_the_others(scene):
    s = scene()
    s.run(0.5)
    before = s.machine.joint_positions
    drive(s, {"arm": -0.2}, 1.0)
    moved = s.machine.joint_positions - before
    assert moved[2] < -0.15
    assert np.abs(moved[[0, 1, 3]]).max() < 1e-3


@pytest.mark.parametrize(
    ("joints", "tracks"),
    [
        ([0.1, math.nan, 0.0, 0.0], [0.0, 0.0]),
        ([0.1, math.inf, 0.0, 0.0], [0.0, 0.0]),
        ([0.1, 0.0, 0.0], [0.0, 0.0]),
        ([0.1, 0.0, 0.0, 0.0], [0.5, math.nan]),
        ([0.1, 0.0, 0.0, 0.0], [0.5]),
        ([0.1, 0.0, 0.0, 0.0], [0.5, 0.5, 0.5]),
        ({"blade": 0.1}, [0.0, 0.0]),
        ({"arm": math.nan}, [0.0, 0.0]),
        ("kinematic", [0.0, 0.0]),
        (None, [0.0, 0.0]),
    ],
)
def test_invalid_command_is_rejected_and_changes_nothing(scene, joints, tracks):
    s, untouched = scene(), scene()
    for each in (s, untouched):
        each.machine.command([0.2, 0.0, -0.1, 0.0], [0.3, 0.3])
        each.run(0.2)
    with pytest.raises(MachineError):
        s.machine.command(joints, tracks)
    s.run(0.2)
    untouched.run(0.2)
    np.testing.assert_array_equal(state(s.machine), state(untouched.machine))


def test_invalid_wrench_is_rejected_and_changes_nothing(scene):
    s, untouched = scene(), scene()
    with pytest.raises(MachineError):
        s.machine.tool.push([0.0, math.nan, 0.0], np.zeros(3), np.zeros(3))
    with pytest.raises(MachineError):
        s.machine.tool.push(np.ones(3) * 1e4, np.zeros(3), [0.0, math.inf, 0.0])
    s.run(0.1)
    untouched.run(0.1)
    np.testing.assert_array_equal(state(s.machine), state(untouched.machine))


def test_equal_commands_give_bit_identical_states(scene):
    rng = np.random.default_rng(5)
    commands = [(rng.uniform(-1, 1, 4), rng.uniform(-1, 1, 2)) for _ in range(20)]
    runs = []
    for _ in range(2):
        s = scene(lambda x, y: 0.1 * np.sin(x) * np.cos(1.3 * y))
        states = []
        for joints, tracks in commands:
            drive(s, joints, 0.1, tracks)
            states.append(state(s.machine))
        runs.append(np.array(states))
    assert np.isfinite(runs[0]).all()
    np.testing.assert_array_equal(runs[0], runs[1])


def test_tool_pose_is_that_of_the_kinematics(scene, spec):
    s = scene(slope_deg=10, yaw=1.0)
    for command in ([0.4, -0.2, 0.3, -0.5], [-0.8, 0.3, -0.6, 0.4]):
        drive(s, command, 1.0, [0.2, -0.1])
        position, quaternion = s.machine.base_pose
        rotation, origin = tool_pose(
            spec, position, rotation_matrix(quaternion), s.machine.joint_positions
        )
        np.testing.assert_allclose(s.machine.tool.pose[0], rotation, atol=1e-6)
        np.testing.assert_allclose(s.machine.tool.pose[1], origin, atol=1e-6)


def test_tool_velocity_is_the_derivative_of_its_pose(scene):
    s = scene()
    drive(s, [0.5, -0.2, 0.4, -0.5], 0.8, [0.4, 0.2])
    before, origin = s.machine.tool.pose
    s.step()
    after, moved = s.machine.tool.pose
    velocity, angular_velocity = s.machine.tool.velocity
    np.testing.assert_allclose((moved - origin) / DT, velocity, atol=5e-3)
    turn = (after @ before.T - np.eye(3)) / DT
    np.testing.assert_allclose([turn[2, 1], turn[0, 2], turn[1, 0]], angular_velocity, atol=5e-3)


def test_pose_is_not_modified_by_later_steps(scene):
    s = scene()
    drive(s, [0.5, 0.0, 0.0, 0.0], 0.5)
    rotation, origin = s.machine.tool.pose
    expected_pose = rotation.copy(), origin.copy()
    s.run(0.1)
    np.testing.assert_array_equal(rotation, expected_pose[0])
    np.testing.assert_array_equal(origin, expected_pose[1])
    assert not np.array_equal(s.machine.tool.pose[1], origin)


def test_tool_wrench_changes_joint_efforts_by_virtual_work(scene, spec):
    """The efforts change by minus the power of the wrench per unit of joint velocity."""
    loaded, free = scene(), scene()
    force, torque = np.array([3e3, 1e3, -6e3]), np.array([500.0, -800.0, 300.0])
    offset = np.array([0.9, 0.2, 0.3])
    for _ in range(600):
        rotation, origin = loaded.machine.tool.pose
        loaded.machine.tool.push(force, torque, origin + rotation @ offset)
        loaded.step()
        free.step()
    base, quaternion = loaded.machine.base_pose
    frame, joints, h = rotation_matrix(quaternion), loaded.machine.joint_positions, 1e-5
    now, _ = tool_pose(spec, base, frame, joints)
    expected = []
    for step in np.eye(4) * h:
        ahead, behind = (tool_pose(spec, base, frame, joints + sign * step) for sign in (1, -1))
        speed = (ahead[1] + ahead[0] @ offset - behind[1] - behind[0] @ offset) / (2.0 * h)
        turn = (ahead[0] - behind[0]) @ now.T / (2.0 * h)
        expected.append(-(force @ speed + torque @ [turn[2, 1], turn[0, 2], turn[1, 0]]))
    change = loaded.machine.joint_efforts - free.machine.joint_efforts
    # The load tilts the base by 3.5 mrad, so that the arm's weight contributes up to 200 N m.
    np.testing.assert_allclose(change, expected, rtol=1e-3, atol=300.0)


def test_tool_wrench_lasts_one_step(scene, spec):
    s = scene()
    s.run(3.0)
    rest = s.machine.joint_efforts[1]
    s.machine.tool.push([0.0, 0.0, -2e4], np.zeros(3))
    s.step()
    assert s.machine.joint_efforts[1] < rest - 1e4
    s.run(3.0)
    assert s.machine.joint_efforts[1] == pytest.approx(rest, rel=1e-2)


def test_overloaded_joint_yields_without_wind_up(scene, spec):
    s = scene()
    s.run(0.5)
    limit = spec.joints["bucket"].max_effort
    start = s.machine.joint_positions[3]
    for _ in range(10):
        s.machine.tool.push(np.zeros(3), [0.0, -1.5 * limit, 0.0])
        s.step()
    given = s.machine.joint_positions[3]
    assert given < start - 0.02
    assert abs(s.machine.joint_efforts[3]) <= limit * (1.0 + 1e-6)
    s.run(2.0)
    assert (
        s.machine.joint_positions[3] < start - 2.0 * MAX_REFERENCE_LEAD
    )  # it does not spring back


def test_load_at_full_reach_tilts_the_machine(scene):
    s = scene()
    drive(s, [0.0, 0.6, -1.1, -0.5], 1.2)
    s.machine.command([0.0] * 4, STILL)
    assert not s.machine.overturned
    tilts = []
    for _ in range(400):
        s.machine.tool.push([0.0, 0.0, -6e4], np.zeros(3))
        s.step()
        tilts.append(s.machine.tilt)
    assert max(tilts) > 0.15


def test_overturned_machine_rests_on_its_main_body(scene, spec):
    s = scene()
    upside_down = pybullet.getQuaternionFromEuler((math.pi, 0.0, 0.0))
    roof = arm_geometry(spec).swing[2] + 1.3
    s.client.resetBasePositionAndOrientation(s.machine.body, [0.0, 0.0, roof], upside_down)
    s.machine.after_step()
    s.run(10.0)
    assert s.machine.overturned
    assert s.position[2] > 1.5  # without contact of the main body it would rest at 0.8
    assert np.linalg.norm(s.machine.base_velocity[0]) < 0.1


def test_two_machines_share_a_client(spec, scene):
    s = scene()
    other = TrackedMachine(spec, s.machine.client_id, s.ground, (0.0, 9.0), math.pi)
    s.machine.command([0.0] * 4, [0.5, 0.5])
    start = other.base_pose[0]
    for _ in range(200):
        s.machine.before_step(DT)
        other.before_step(DT)
        s.client.stepSimulation()
        s.machine.after_step()
        other.after_step()
    assert s.position[0] > 0.3
    assert np.linalg.norm(other.base_pose[0] - start) < 0.01
    assert isinstance(s.client, BulletClient)
