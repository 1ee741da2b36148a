"""Link poses agree with the arm kinematics and with the physics."""

import math

import numpy as np
import pytest

from machine_sim.machine import MachineError, rotation_matrix, tool_pose
from machine_sim.machine.forward_kinematics import link_frame_names, link_poses

JOINTS = [0.7, -0.4, 1.3, 1.1]
POSITION = [3.0, -2.0, 0.5]


def test_bucket_is_at_the_tool_pose(spec):
    rng = np.random.default_rng(6)
    for _ in range(50):
        place, quaternion = rng.uniform(-50.0, 50.0, 3), rng.normal(size=4)
        joints = rng.uniform(-3.0, 3.0, 4)
        poses = link_poses(spec, place, quaternion, joints)
        rotation, origin = tool_pose(spec, place, rotation_matrix(quaternion), joints)
        np.testing.assert_allclose(poses.positions[4], origin, atol=1e-12)
        np.testing.assert_allclose(rotation_matrix(poses.quaternions[4]), rotation, atol=1e-12)


def test_link_poses_are_those_of_the_physics(scene, spec):
    s = scene(slope_deg=10, yaw=1.0)
    s.machine.command([0.4, -0.2, 0.3, -0.5], [0.2, -0.1])
    s.run(1.0)
    machine, client = s.machine, s.client
    poses = link_poses(spec, *machine.base_pose, machine.joint_positions)
    np.testing.assert_allclose(poses.positions[0], machine.base_pose[0])
    names = {
        client.getJointInfo(machine.body, k)[12].decode(): k
        for k in range(client.getNumJoints(machine.body))
    }
    assert set(names) == set(link_frame_names(spec)[1:5])
    for k, name in enumerate(link_frame_names(spec)[1:5], start=1):
        state = client.getLinkState(machine.body, names[name], 0, 1)
        np.testing.assert_allclose(poses.positions[k], state[4], atol=5e-6)
        np.testing.assert_allclose(
            rotation_matrix(poses.quaternions[k]), rotation_matrix(state[5]), atol=5e-6
        )


def test_quaternions_have_unit_length_for_any_base_quaternion(spec):
    poses = link_poses(spec, POSITION, [0.2, 0.4, -0.6, 1.8], JOINTS)
    np.testing.assert_allclose(np.linalg.norm(poses.quaternions, axis=1), 1.0, atol=1e-12)
    same = link_poses(spec, POSITION, [0.1, 0.2, -0.3, 0.9], JOINTS)
    np.testing.assert_allclose(poses.positions, same.positions, atol=1e-12)


@pytest.mark.parametrize("quaternion", [[0.0] * 4, [math.nan, 0.0, 0.0, 1.0]])
def test_invalid_base_quaternion_is_rejected(spec, quaternion):
    with pytest.raises(MachineError, match="base_quaternion"):
        link_poses(spec, POSITION, quaternion, JOINTS)
