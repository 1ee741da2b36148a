"""Link poses and visual shapes agree with the kinematics, the physics and the URDF."""

import math

import numpy as np
import pybullet
import pytest

from machine_sim.machine import MachineError, rotation_matrix, tool_pose
from machine_sim.machine.forward_kinematics import link_frame_names, link_poses
from machine_sim.machine.visuals import link_visual_boxes, shoe_visual

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
        state = pybullet.getLinkState(machine.body, names[name], 0, 1, client._client)
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


def test_visual_boxes_are_those_of_the_specification(spec):
    visuals = link_visual_boxes(spec)
    for frame, link in zip(link_frame_names(spec)[:4], list(spec.links.values())[:-1], strict=True):
        boxes = [(box.size, box.center, box.pitch) for box in visuals if box.link == frame]
        assert boxes == [(box.size, box.center, box.pitch) for box in link.boxes]


def test_visual_boxes_of_the_bucket_are_its_shell(spec):
    """Every plate has a box at its middle, and the opening has none."""
    boxes = [box for box in link_visual_boxes(spec) if box.link == "bucket"]
    middles = np.array([box.center for box in boxes])
    for plate in spec.bucket.plates()[:6]:
        assert np.linalg.norm(middles - plate.mean(axis=0), axis=1).min() < 1e-9
    assert {round(abs(y), 9) for y in middles[6:, 1]} == {
        0.5 * (spec.bucket.width + spec.bucket.plate_thickness)
    }


def test_link_names_have_the_prefix(spec):
    boxes = link_visual_boxes(spec, prefix="digger/")
    assert {box.link for box in boxes} == {f"digger/{name}" for name in link_frame_names(spec)}


def test_colours_are_in_range_and_differ(spec):
    colors = [*(box.color for box in link_visual_boxes(spec)), shoe_visual(spec).color]
    assert all(len(color) == 4 and all(0.0 <= part <= 1.0 for part in color) for color in colors)
    assert len(set(colors)) >= 3


def test_shoes_have_gaps_between_them(spec):
    visual, tracks = shoe_visual(spec), spec.tracks
    assert 0.9 * tracks.pitch < visual.shoe_size[0] < tracks.pitch
    assert visual.shoe_size[1:] == (tracks.shoe_width, tracks.shoe_thickness)
    assert (visual.shoe_count, visual.gauge) == (tracks.shoe_count, tracks.gauge)
