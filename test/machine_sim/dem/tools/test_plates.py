"""Plates: closest points, and validation of polygons."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.particle_scenes import pose

from machine_sim.dem import ParticleError
from machine_sim.dem.lifecycle.settling import distance_to_plates
from machine_sim.dem.tools import RigidTool


def brute_force_distance(polygon, point):
    """Return the distance of a point to a dense set of points on a convex polygon."""
    u, v = np.meshgrid(np.linspace(0, 1, 161), np.linspace(0, 1, 161))
    u, v = u[u + v <= 1.0 + 1e-9], v[u + v <= 1.0 + 1e-9]
    distance = np.inf
    for b, c in pairwise(polygon[1:]):
        a = polygon[0]
        samples = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        distance = min(distance, np.linalg.norm(samples - point, axis=1).min())
    return distance


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), num_corners=st.integers(3, 8))
def test_distance_to_a_plate_agrees_with_brute_force(seed, num_corners):
    rng = np.random.default_rng(seed)
    angle = (np.arange(num_corners) + rng.uniform(0.0, 0.8, num_corners)) * 2 * np.pi / num_corners
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    ring = np.stack([np.cos(angle), 0.6 * np.sin(angle), np.zeros(num_corners)], axis=1)
    polygon = ring @ rotation.T + rng.normal(size=3)
    centre = polygon.mean(axis=0)
    point = centre + rng.normal(size=3)
    plates = RigidTool([polygon], pose()).plates
    expected = brute_force_distance(polygon, point)
    assert distance_to_plates(plates, 0, 1, *point) == pytest.approx(expected, abs=0.01)
    above = centre + 0.3 * np.cross(ring[0], ring[1]) @ rotation.T
    assert distance_to_plates(plates, 0, 1, *above) <= np.linalg.norm(above - centre) + 1e-9


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
def test_invalid_plate_is_rejected_with_its_fault(corners, fault):
    with pytest.raises(ParticleError, match=fault):
        RigidTool([corners], pose())
