"""Gather and scatter of four contacts at a time, beside plain numpy."""

import numpy as np
from numba import njit

from machine_sim.dem.contacts.simd import GROUP_SIZE, gather_relative_motion, scatter_forces

STRIDE = 12


@njit
def gather(body, first, second, at, scratch, slot):
    gather_relative_motion(body, first, second, at, scratch, STRIDE, slot)


@njit
def scatter(body, force_sums, first, second, at, scratch, slot):
    scatter_forces(body, force_sums, first, second, at, scratch, STRIDE, slot)


def contacts():
    """Some records, and contacts that share rows within a group."""
    body = np.random.default_rng(1).normal(size=(6, 16)).astype(np.float32)
    first = np.array([0, 1, 1, 1, 2, 2, 3, 5], np.uint32)
    second = np.array([1, 2, 3, 4, 3, 4, 4, 0], np.uint32)
    return body, first, second


def test_gathers_differences_and_the_sum_of_surface_speeds():
    body, first, second = contacts()
    scratch = np.zeros(9 * STRIDE, np.float32)
    gather(body, first, second, 4, scratch, 8)
    found = scratch.reshape(9, STRIDE)
    i, j = body[first[4:]], body[second[4:]]
    expected = np.hstack([j[:, 0:3] - i[:, 0:3], j[:, 4:7] - i[:, 4:7], i[:, 8:11] + j[:, 8:11]])
    np.testing.assert_allclose(found[:, 8 : 8 + GROUP_SIZE], expected.T, rtol=1e-6, atol=1e-6)
    assert not found[:, :8].any(), "it writes nowhere else"


def test_scatters_to_both_particles_also_where_contacts_share_one():
    body, first, second = contacts()
    force = np.random.default_rng(2).normal(size=(7, STRIDE)).astype(np.float32)
    force_sums = np.random.default_rng(3).normal(size=(6, 16)).astype(np.float32)
    expected = force_sums.astype(np.float64)
    for slot, (i, j) in enumerate(
        zip(first[:GROUP_SIZE], second[:GROUP_SIZE], strict=True), start=4
    ):
        f, turn, limit = force[:3, slot], force[3:6, slot], force[6, slot]
        for own, other, sign in ((i, j, -1.0), (j, i, 1.0)):
            expected[own, 0:3] += sign * f
            expected[own, 3] += limit
            expected[own, 4:7] += turn
            expected[own, 12:15] += limit * body[other, 12:15]
    scatter(body, force_sums, first, second, 0, force.reshape(-1), 4)
    np.testing.assert_allclose(force_sums, expected, rtol=1e-5, atol=1e-5)
