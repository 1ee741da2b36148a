"""Geometry of plates and hulls."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.particle_scenes import box, pose, square

from machine_sim.particles import ParticleError
from machine_sim.particles.landing import tool_gap
from machine_sim.particles.tool import RigidTool, ToolSet


def brute_force(polygon, point):
    """Distance to a convex polygon by trying its triangle fan densely."""
    u, v = np.meshgrid(np.linspace(0, 1, 161), np.linspace(0, 1, 161))
    u, v = u[u + v <= 1.0 + 1e-9], v[u + v <= 1.0 + 1e-9]
    nearest = np.inf
    for b, c in pairwise(polygon[1:]):
        a = polygon[0]
        on = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        nearest = min(nearest, np.linalg.norm(on - point, axis=1).min())
    return nearest


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), corners=st.integers(3, 8))
def test_closest_point_agrees_with_brute_force(seed, corners):
    rng = np.random.default_rng(seed)
    angle = (np.arange(corners) + rng.uniform(0.0, 0.8, corners)) * 2 * np.pi / corners
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    ring = np.stack([np.cos(angle), 0.6 * np.sin(angle), np.zeros(corners)], axis=1)
    polygon = ring @ turn.T + rng.normal(size=3)
    tool = RigidTool([polygon], pose())
    point = polygon.mean(axis=0) + rng.normal(size=3)
    assert tool_gap(point, tool) == pytest.approx(brute_force(polygon, point), abs=0.01)
    on_face = polygon.mean(axis=0) + 0.3 * np.cross(ring[0], ring[1]) @ turn.T
    assert tool_gap(on_face, tool) <= np.linalg.norm(on_face - polygon.mean(axis=0)) + 1e-9


def test_the_hull_of_a_box_holds_its_inside():
    tool = RigidTool(box(2.0, 1.0, 0.5), pose())
    points = np.array([[0.9, 0.4, 0.4], [0.0, 0.0, 0.6], [1.1, 0, 0.2], [0, 0, -0.1], [0, 0, 0.1]])
    np.testing.assert_array_equal(tool.contains(points), [True, False, False, False, True])


def test_a_single_plate_encloses_nothing():
    assert not RigidTool([square(1.0)], pose()).contains(np.zeros((3, 3))).any()


@pytest.mark.parametrize(
    ("corners", "fault"),
    [
        ([[0, 0, 0], [1, 0, 0]], "shape"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0.3], [0, 1, 0]], "planar"),
        ([[0, 0, 0], [2, 0, 0], [0.2, 0.2, 0], [0, 2, 0]], "convex"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], "area"),
        ([[0, 0, 0], [1, 0, 0], [np.nan, 1, 0]], "finite"),
    ],
)
def test_a_bad_plate_is_refused_with_its_fault(corners, fault):
    with pytest.raises(ParticleError, match=fault):
        RigidTool([corners], pose())


def test_a_pose_path_is_a_constant_twist_between_its_ends():
    tools = ToolSet(5)
    tools.add(0, RigidTool([square(1.0)], pose()))
    tools.tools[0].move(pose(1.0, 0.0, 2.0, 0.1), pose(1.5, 0.0, 2.0, 0.4))
    tools.begin(0.005)
    np.testing.assert_allclose(tools.twist[0], [100.0, 0, 0, 0, 60.0, 0], atol=1e-9)
    for s in range(6):
        turn, place = pose(1.0 + 0.1 * s, 0.0, 2.0, 0.1 + 0.06 * s)
        np.testing.assert_allclose(tools.path[s, 0], [*turn.reshape(-1), *place], atol=1e-12)


@pytest.mark.parametrize("bad", [np.zeros((3, 3)), np.diag([1.0, 1.0, -1.0]), np.eye(2)])
def test_a_pose_that_is_none_is_refused(bad):
    with pytest.raises(ParticleError):
        RigidTool([square(1.0)], (bad, np.zeros(3)))
