"""Convex hull of a tool's corners."""

import tracemalloc
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.particle_scenes import box, pose, square

from machine_sim.dem.tools import RigidTool
from machine_sim.dem.tools.convex_hull import convex_hull_planes


def test_hull_of_a_box_contains_its_inside():
    tool = RigidTool(box(2.0, 1.0, 0.5), pose())
    points = np.array([[0.9, 0.4, 0.4], [0.0, 0.0, 0.6], [1.1, 0, 0.2], [0, 0, -0.1], [0, 0, 0.1]])
    np.testing.assert_array_equal(tool.contains(points), [True, False, False, False, True])


def test_single_plate_encloses_nothing():
    assert not RigidTool([square(1.0)], pose()).contains(np.zeros((3, 3))).any()


def brute_force_hull(points):
    """Return the planes through three corners that have no corner beyond them."""
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
@given(seed=st.integers(0, 10**6), num_corners=st.integers(4, 12), on_lattice=st.booleans())
def test_hull_agrees_with_brute_force(seed, num_corners, on_lattice):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(num_corners, 3))
    if on_lattice:  # many corners are coplanar, collinear or the same
        points = rng.integers(0, 3, (num_corners, 3)).astype(float)
    expected = brute_force_hull(np.unique(points, axis=0))
    planes = convex_hull_planes(points)
    assert len(planes) == len(expected)
    for plane in expected:
        assert np.abs(planes - plane).max(axis=1).min() < 2e-6


@pytest.mark.parametrize("is_rotated", [False, True])
def test_drum_of_many_corners_has_a_small_hull(is_rotated):
    angle = 2.0 * np.pi * np.arange(121) / 120
    ring = 0.5 * np.stack([np.cos(angle), np.sin(angle), np.zeros(121)], axis=1)
    rotation = np.eye(3)
    if is_rotated:
        rotation = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    low, high = (ring @ rotation, (ring + np.array([0.0, 0.0, 2.0])) @ rotation)
    sides = [[low[k], low[k + 1], high[k + 1], high[k]] for k in range(120)]
    tracemalloc.start()
    tool = RigidTool(sides, pose())
    _, peak_memory = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_memory < 100e6, "the memory of all planes through three corners"
    assert 122 <= len(tool.hull) < 150, "two ends and 120 sides, few of them twice"
    points = np.random.default_rng(0).uniform([-0.6, -0.6, -0.2], [0.6, 0.6, 2.2], (4000, 3))
    radius = np.hypot(points[:, 0], points[:, 1]) / np.cos(np.pi / 120)
    is_clear = (np.abs(radius - 0.5) > 4e-4) & (np.abs(np.abs(points[:, 2] - 1.0) - 1.0) > 1e-4)
    inside = (radius < 0.5) & (np.abs(points[:, 2] - 1.0) < 1.0)
    np.testing.assert_array_equal(tool.contains(points @ rotation)[is_clear], inside[is_clear])
