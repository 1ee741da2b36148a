"""machine_faces, machine_outline: the machine as flat faces in its pose."""

import re

import numpy as np
import pytest
from support.machine_scenes import excavator
from support.operator_scenes import tilted

from earthmoving_sim.machine_polygons import machine_faces, machine_outline
from machine_sim.machine import tool_pose
from machine_sim.machine.rotations import rotation_about_z
from machine_sim.machine.visuals import link_visual_boxes

MACHINE = excavator()
POSITION = np.array([3.0, -2.0, 0.5])
ROTATION = tilted(roll=0.05, pitch=-0.1, yaw=0.8)
POSE = (POSITION, ROTATION, [0.7, -0.4, 1.3, 1.1])
BOXES = link_visual_boxes(MACHINE)


def encloses(polygon: np.ndarray, point: np.ndarray) -> bool:
    """Return whether a point (2,) lies inside a convex polygon (k, 2)."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    offset = point - polygon
    side = edge[:, 0] * offset[:, 1] - edge[:, 1] * offset[:, 0]
    return bool((side > 0).all() or (side < 0).all())


def test_bucket_is_drawn_where_the_tool_is():
    rotation, pin = tool_pose(MACHINE, *POSE)
    first = next(k for k, box in enumerate(BOXES) if box.link == "bucket")
    strip = np.array([face for _, face in machine_faces(MACHINE, *POSE)[6 * first : 6 * first + 6]])
    middle = strip.reshape(-1, 3).mean(axis=0)
    floor = MACHINE.bucket.plates()[0].mean(axis=0)
    np.testing.assert_allclose(middle, floor @ rotation.T + pin, atol=1e-6)


def test_every_box_has_six_faces_of_four_corners():
    faces = machine_faces(MACHINE, *POSE)
    assert len(faces) == 6 * len(BOXES)
    assert {face.shape for _, face in faces} == {(4, 3)}


def test_faces_of_a_box_are_flat_rectangles_of_its_size():
    first = MACHINE.links["base"].boxes[0]
    faces = [face for _, face in machine_faces(MACHINE, *POSE)[:6]]
    for face in faces:
        np.testing.assert_allclose(face[0] + face[2], face[1] + face[3], atol=1e-9)
    edges = {round(float(np.linalg.norm(f[k] - f[k - 1])), 6) for f in faces for k in range(4)}
    assert edges == set(first.size)


def test_arm_is_drawn_from_the_boom_to_the_bucket():
    _, pin = tool_pose(MACHINE, *POSE)
    arm_boxes = [k for k, box in enumerate(BOXES) if box.link == "arm"]
    faces = machine_faces(MACHINE, *POSE)
    arm = np.concatenate([face for k in arm_boxes for _, face in faces[6 * k : 6 * k + 6]])
    assert np.linalg.norm(arm - pin, axis=1).min() < 0.5


def test_every_face_has_a_colour():
    colours = [colour for colour, _ in machine_faces(MACHINE, *POSE)]
    assert all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in colours)
    assert len(set(colours)) >= 3


def test_outline_has_tracks_and_upper_body():
    names = [name for name, _ in machine_outline(MACHINE, *POSE)]
    assert names.count("base") == len(MACHINE.links["base"].boxes)
    assert names.count("upper") == len(MACHINE.links["upper"].boxes)


def test_outline_encloses_the_position_of_the_machine():
    enclosing = [p for name, p in machine_outline(MACHINE, *POSE) if encloses(p, POSITION[:2])]
    assert enclosing
    assert not any(
        encloses(polygon, POSITION[:2] + 10.0) for _, polygon in machine_outline(MACHINE, *POSE)
    )


def test_tracks_lie_on_both_sides_of_the_middle():
    outline = [polygon for name, polygon in machine_outline(MACHINE, *POSE) if name == "base"]
    left = ROTATION[:2, 1]
    sides = sorted((polygon.mean(axis=0) - POSITION[:2]) @ left for polygon in outline)
    assert sides[0] < -0.8
    assert sides[-1] > 0.8


@pytest.mark.parametrize("swing", [0.0, 2.0])
def test_upper_body_turns_with_the_swing_and_the_tracks_do_not(swing):
    level = (np.zeros(3), np.eye(3))
    before = machine_outline(MACHINE, *level, [0.0, 0.0, 1.0, 0.0])
    after = machine_outline(MACHINE, *level, [swing, 0.0, 1.0, 0.0])
    turn = rotation_about_z(swing)[:2, :2]
    for (name, old), (_, new) in zip(before, after, strict=True):
        np.testing.assert_allclose(new, old @ turn.T if name == "upper" else old, atol=1e-9)


def test_shoes_are_drawn_around_their_poses_on_both_sides():
    shoes = np.array([[[0.5, 0.03, np.pi]], [[-0.5, 0.75, 0.0]]])
    plain, with_shoes = machine_faces(MACHINE, *POSE), machine_faces(MACHINE, *POSE, shoes)
    assert len(with_shoes) == len(plain) + 2 * 6
    drawn = with_shoes[-12:]
    for k, (x, y, z) in enumerate(((0.5, 1.19, 0.03), (-0.5, -1.19, 0.75))):
        middle = np.mean([face.mean(axis=0) for _, face in drawn[6 * k : 6 * k + 6]], axis=0)
        assert middle == pytest.approx(ROTATION @ [x, y, z] + POSITION, abs=1e-9)
