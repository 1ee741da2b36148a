"""Shape of the bucket: plates, key points, capacities, points moved inside."""

import numpy as np
import pytest
from support.containers import rows_in_heap

from machine_sim.machine import BucketShape, MachineError
from machine_sim.machine.rotations import rotation_about_z


@pytest.fixture
def bucket(spec):
    return spec.bucket


@pytest.fixture
def inside(bucket):
    """Return random points, and whether each is in the struck volume by a half-plane test."""
    rng = np.random.default_rng(2)
    points = rng.uniform([-0.5, -1.0, -0.8], [1.8, 1.0, 1.0], (4000, 3))
    corners = bucket.profile
    within = np.abs(points[:, 1]) <= 0.6
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        side = (b[0] - a[0]) * (points[:, 2] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0])
        within &= side >= 0.0
    return points, within


def test_capacities_are_those_of_a_one_cubic_metre_bucket(bucket):
    assert bucket.struck_capacity == pytest.approx(0.75, abs=0.03)
    assert 1.0 <= bucket.heaped_capacity <= 1.1


def test_heaped_capacity_is_the_integral_of_a_one_to_one_roof(bucket):
    n = 1000
    u = (np.arange(n) + 0.5) / n * bucket.opening_length
    w = (np.arange(n) + 0.5) / n * bucket.width
    u, w = np.meshgrid(u, w)
    roof = np.minimum(np.minimum(u, bucket.opening_length - u), np.minimum(w, bucket.width - w))
    heap = roof.mean() * bucket.opening_length * bucket.width
    assert bucket.heaped_capacity - bucket.struck_capacity == pytest.approx(heap, rel=1e-4)


def test_contains_agrees_with_half_planes_and_struck_capacity(bucket, inside):
    points, within = inside
    np.testing.assert_array_equal(bucket.contains(points), within)
    box = 2.3 * 2.0 * 1.8
    assert within.mean() * box == pytest.approx(bucket.struck_capacity, rel=0.1)


def test_heap_is_a_prism_over_the_opening(bucket, inside):
    points, within = inside
    assert set(rows_in_heap(bucket, points)) >= set(np.flatnonzero(within))
    middle = 0.5 * (bucket.profile[0] + bucket.profile[-1])
    over = np.array([middle[0], 0.0, middle[1]]) + np.outer([0.59, 0.61], bucket.opening_normal)
    assert rows_in_heap(bucket, over) == [0]
    assert not bucket.contains(over).any()
    rotation, origin = rotation_about_z(0.7), np.array([3.0, -4.0, 1.0])
    assert rows_in_heap(bucket, over @ rotation.T + origin, (rotation, origin)) == [0]


def test_plates_close_the_shell(bucket):
    """Every edge belongs to two plates, in opposite directions, except those of the opening."""
    edges = {}
    for plate in bucket.plates():
        for a, b in zip(plate, np.roll(plate, -1, axis=0), strict=True):
            edges[tuple(a), tuple(b)] = edges.get((tuple(a), tuple(b)), 0) + 1
    assert set(edges.values()) == {1}
    opening = {(a, b) for a, b in edges if (b, a) not in edges}
    ends = {tuple(p) for p in (*bucket.key_points[:2], *bucket.key_points[-2:])}
    assert len(opening) == 4
    assert {corner for edge in opening for corner in edge} == ends


def test_plates_are_planar_convex_and_face_outward(bucket):
    middle = np.array([*bucket.profile.mean(axis=0)])
    for plate in bucket.plates():
        normal = np.cross(plate[1] - plate[0], plate[2] - plate[1])
        assert np.abs((plate - plate[0]) @ normal).max() < 1e-12
        edge = np.roll(plate, -1, axis=0) - plate
        turns = np.cross(edge, np.roll(edge, -1, axis=0)) @ normal
        assert (turns > 0.0).all()
        assert normal @ (plate.mean(axis=0) - [middle[0], 0.0, middle[1]]) > 0.0


def test_key_points_run_from_lip_to_rim_left_before_right(bucket):
    points = bucket.key_points
    assert points.shape == (14, 3)
    np.testing.assert_array_equal(points[0::2, 1], 0.6)
    np.testing.assert_array_equal(points[1::2, 1], -0.6)
    np.testing.assert_array_equal(points[0::2][:, [0, 2]], bucket.profile)
    np.testing.assert_array_equal(points[0], [1.45, 0.6, 0.0])


def test_outward_normals_point_out_of_the_bucket(bucket):
    normals = bucket.outward_normals
    points = bucket.key_points[0::2] * [1.0, 0.0, 1.0]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert not bucket.contains(points + 1e-6 * normals).any()
    assert bucket.contains(points[1:-1] - 1e-6 * normals[1:-1]).all()


def test_opening_normal_points_out_of_the_opening(bucket):
    assert bucket.opening_normal @ [1.0, 0.0, 0.0] == pytest.approx(0.0, abs=0.1)
    assert bucket.opening_normal[2] < -0.95
    assert np.linalg.norm(bucket.opening_normal) == pytest.approx(1.0)


def test_clamped_points_keep_the_clearance_from_every_plate(bucket, inside):
    points, _ = inside
    moved = bucket.clamp_inside(points, 0.05)
    assert bucket.contains(moved).all()
    for plate in bucket.plates():
        normal = np.cross(plate[1] - plate[0], plate[2] - plate[1])
        distance = (plate[0] - moved) @ (normal / np.linalg.norm(normal))
        assert distance.min() > 0.05 - 1e-9


def test_points_with_enough_clearance_are_unchanged(bucket):
    points = np.array([[0.7, 0.1, 0.3], [0.8, -0.5, 0.2]])
    np.testing.assert_array_equal(bucket.clamp_inside(points, 0.05), points)


def test_too_large_a_clearance_is_rejected(bucket):
    with pytest.raises(MachineError, match="smaller"):
        bucket.clamp_inside(np.zeros((1, 3)), 0.7)


def test_star_shaped_profile_is_rejected():
    turn = np.arange(7) * 3 * 2 * np.pi / 7
    star = np.column_stack([np.cos(turn), np.sin(turn)])
    with pytest.raises(MachineError, match="not convex"):
        BucketShape(profile=star, width=1.2)
