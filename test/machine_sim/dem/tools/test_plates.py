"""Geometry of plates and hulls."""

import tracemalloc
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.particle_scenes import box, pose, square

from machine_sim.dem import ParticleError
from machine_sim.dem.lifecycle.landing import distance_to_plates
from machine_sim.dem.tools.plates import convex_hull_planes
from machine_sim.dem.tools.rigid_tool import RigidTool, ToolSet


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
    point = polygon.mean(axis=0) + rng.normal(size=3)
    plates = RigidTool([polygon], pose()).plates
    assert distance_to_plates(plates, *point) == pytest.approx(
        brute_force(polygon, point), abs=0.01
    )
    on_face = polygon.mean(axis=0) + 0.3 * np.cross(ring[0], ring[1]) @ turn.T
    assert (
        distance_to_plates(plates, *on_face)
        <= np.linalg.norm(on_face - polygon.mean(axis=0)) + 1e-9
    )


def test_the_hull_of_a_box_holds_its_inside():
    tool = RigidTool(box(2.0, 1.0, 0.5), pose())
    points = np.array([[0.9, 0.4, 0.4], [0.0, 0.0, 0.6], [1.1, 0, 0.2], [0, 0, -0.1], [0, 0, 0.1]])
    np.testing.assert_array_equal(tool.contains(points), [True, False, False, False, True])


def test_a_single_plate_encloses_nothing():
    assert not RigidTool([square(1.0)], pose()).contains(np.zeros((3, 3))).any()


def hull_by_trying(points):
    """Planes through three corners that have none beyond them."""
    planes = []
    for a, b, c in combinations(points, 3):
        normal = np.cross(b - a, c - a)
        normal = normal / max(np.linalg.norm(normal), 1e-12)
        for sign in (-1.0, 1.0):
            heights = sign * (points - a) @ normal
            if np.linalg.norm(normal) > 0.5 and heights.min() < -1e-5 and heights.max() < 1e-7:
                planes.append([*(sign * normal), sign * normal @ a])
    return np.unique(np.round(planes, 6) + 0.0, axis=0)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), corners=st.integers(4, 12), whole=st.booleans())
def test_a_hull_is_the_planes_with_no_corner_beyond(seed, corners, whole):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(corners, 3))
    if whole:  # many in one plane, in one line, or the same
        points = rng.integers(0, 3, (corners, 3)).astype(float)
    wanted = hull_by_trying(np.unique(points, axis=0))
    found = convex_hull_planes(points)
    assert len(found) == len(wanted)
    for plane in wanted:
        assert np.abs(found - plane).max(axis=1).min() < 2e-6


@pytest.mark.parametrize("turned", [False, True])
def test_a_drum_of_many_corners_has_a_small_hull(turned):
    angle = 2.0 * np.pi * np.arange(121) / 120
    ring = 0.5 * np.stack([np.cos(angle), np.sin(angle), np.zeros(121)], axis=1)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0] if turned else np.eye(3)
    low, high = (ring @ turn, (ring + np.array([0.0, 0.0, 2.0])) @ turn)
    sides = [[low[k], low[k + 1], high[k + 1], high[k]] for k in range(120)]
    tracemalloc.start()
    tool = RigidTool(sides, pose())
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 100e6, "not one of all planes through three corners"
    assert 122 <= len(tool.hull) < 150, "two ends, 120 sides, hardly any of them twice"
    points = np.random.default_rng(0).uniform([-0.6, -0.6, -0.2], [0.6, 0.6, 2.2], (4000, 3))
    middle = np.hypot(points[:, 0], points[:, 1]) / np.cos(np.pi / 120)
    clear = (np.abs(middle - 0.5) > 4e-4) & (np.abs(np.abs(points[:, 2] - 1.0) - 1.0) > 1e-4)
    inside = (middle < 0.5) & (np.abs(points[:, 2] - 1.0) < 1.0)
    np.testing.assert_array_equal(tool.contains(points @ turn)[clear], inside[clear])


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
    tools.begin_step(0.005)
    np.testing.assert_allclose(tools.twist[0], [100.0, 0, 0, 0, 60.0, 0], atol=1e-9)
    for s in range(6):
        turn, place = pose(1.0 + 0.1 * s, 0.0, 2.0, 0.1 + 0.06 * s)
        np.testing.assert_allclose(tools.path[s, 0], [*turn.reshape(-1), *place], atol=1e-12)


@pytest.mark.parametrize("bad", [np.zeros((3, 3)), np.diag([1.0, 1.0, -1.0]), np.eye(2)])
def test_a_pose_that_is_none_is_refused(bad):
    with pytest.raises(ParticleError):
        RigidTool([square(1.0)], (bad, np.zeros(3)))
