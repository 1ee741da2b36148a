"""machine_mesh: the machine as triangles in its pose."""

import numpy as np
import pytest
from support.machine_scenes import excavator
from support.operator_scenes import tilted

from earthmoving_sim.machine_mesh import machine_mesh
from machine_sim.machine import tool_pose
from machine_sim.machine.shapes.link_meshes import link_meshes, num_triangles, shoe_mesh

MACHINE = excavator()
POSITION = np.array([3.0, -2.0, 0.5])
ROTATION = tilted(roll=0.05, pitch=-0.1, yaw=0.8)
POSE = (POSITION, ROTATION, [0.7, -0.4, 1.3, 1.1])


def test_bucket_is_drawn_where_the_tool_is():
    rotation, pin = tool_pose(MACHINE, *POSE)
    mesh = machine_mesh(MACHINE, *POSE)
    for plate in MACHINE.bucket.plates()[:6]:
        for corner in plate @ rotation.T + pin:
            distance = np.linalg.norm(mesh.points - corner, axis=1).min()
            assert distance < 2.0 * MACHINE.bucket.plate_thickness


def test_all_triangles_of_all_links_are_drawn_in_the_colours_of_their_materials():
    mesh = machine_mesh(MACHINE, *POSE)
    meshes = link_meshes(MACHINE)
    assert len(mesh.triangles) == num_triangles(meshes.values())
    colours = {group.material.color for groups in meshes.values() for group in groups}
    assert {tuple(colour) for colour in np.unique(mesh.colours, axis=0)} == colours
    assert set(mesh.parts) == set(range(1, len(meshes) + 1))


def test_normals_are_rotated_with_the_machine():
    level, tilted_mesh = (
        machine_mesh(MACHINE, POSITION, rotation, POSE[2]) for rotation in (np.eye(3), ROTATION)
    )
    np.testing.assert_allclose(tilted_mesh.normals, level.normals @ ROTATION.T, atol=1e-9)


def test_shoes_are_drawn_around_their_poses_on_both_sides():
    shoes = np.array([[[0.5, 0.03, np.pi]], [[-0.5, 0.75, 0.0]]])
    plain, with_shoes = machine_mesh(MACHINE, *POSE), machine_mesh(MACHINE, *POSE, shoes)
    count = num_triangles([shoe_mesh(MACHINE)])
    assert len(with_shoes.triangles) == len(plain.triangles) + 2 * count
    for k, (x, y, z) in enumerate(((0.5, 1.19, 0.03), (-0.5, -1.19, 0.75))):
        corners = with_shoes.triangles[len(plain.triangles) + k * count :][:count]
        points = with_shoes.points[corners].reshape(-1, 3)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        assert middle == pytest.approx(ROTATION @ [x, y, z] + POSITION, abs=0.05)
