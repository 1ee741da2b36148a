"""Gather and scatter of four contacts or bodies at a time, compared with NumPy."""

import numpy as np
from numba import njit

from machine_sim.dem.body_records import (
    ANGULAR_VELOCITY,
    BODY_RECORD_SIZE,
    CONTACT_RADIUS,
    DISPLACEMENT,
    FORCE_RECORD_SIZE,
    INVERSE_MASS,
    LIMIT_WEIGHTED_ANGULAR_VELOCITY,
    SURFACE_VELOCITY,
    VELOCITY,
)
from machine_sim.dem.body_records import FORCE as FORCE_SUM
from machine_sim.dem.body_records import ROLLING_LIMIT as ROLLING_LIMIT_SUM
from machine_sim.dem.body_records import TORQUE_OVER_RADIUS as TORQUE_SUM
from machine_sim.dem.contacts.separations import gather_separations
from machine_sim.dem.contacts.simd import (
    CLOSING_VELOCITY,
    CONTACT_RADIUS_SUM,
    FORCE,
    GROUP_SIZE,
    INVERSE_MASS_SUM,
    RELATIVE_DISPLACEMENT,
    RELATIVE_VELOCITY,
    ROLLING_LIMIT,
    SURFACE_VELOCITY_SUM,
    TORQUE_OVER_RADIUS,
    add_forces,
    gather_approach,
    gather_motion,
    gather_records,
    gather_relative_motion,
    scatter_forces,
    scatter_records,
)

STRIDE = 12
COLUMNS = 0xFFFF & ~(1 << DISPLACEMENT + 1)
"""All columns of a record but one."""


@njit
def gather(body, first, second, contact, scratch, slot):
    gather_relative_motion(body, first, second, contact, scratch, STRIDE, slot)


@njit
def gather_closing(body, first, second, pair, scratch, slot):
    gather_approach(body, first, second, pair, scratch, STRIDE, slot)


@njit
def gather_vectors(position, first, second, pair, scratch, slot):
    gather_separations(position, first, second, pair, scratch, STRIDE, slot)


@njit
def scatter(body, force_sums, first, second, contact, scratch, slot):
    scatter_forces(body, force_sums, first, second, contact, scratch, STRIDE, slot)


@njit
def gather_one(body, row, contact, scratch, slot):
    gather_motion(body, row, contact, scratch, STRIDE, slot)


@njit
def add_to_one(force_sums, row, contact, scratch, slot):
    add_forces(force_sums, row, contact, scratch, STRIDE, slot)


@njit
def gather_columns(records, row, first, scratch, slot):
    gather_records(records, row, first, scratch, STRIDE, slot, COLUMNS)


@njit
def scatter_all_columns(records, row, first, scratch, slot):
    scatter_records(records, row, first, scratch, STRIDE, slot)


def vector(start):
    """Return the slice of a vector that starts at a slot."""
    return slice(start, start + 3)


def contacts():
    """Return body records, and contacts of which some in a group share a body."""
    body = np.random.default_rng(1).normal(size=(6, BODY_RECORD_SIZE)).astype(np.float32)
    first = np.array([0, 1, 1, 1, 2, 2, 3, 5], np.uint32)
    second = np.array([1, 2, 3, 4, 3, 4, 4, 0], np.uint32)
    return body, first, second


def gathered(gather_group, records, *rows, num_quantities):
    """Return the quantities of four contacts, with the bodies `rows[4:]`."""
    scratch = np.zeros(num_quantities * STRIDE, np.float32)
    gather_group(records, *rows, 4, scratch, 8)
    found = scratch.reshape(num_quantities, STRIDE)
    assert not found[:, :8].any(), "written outside the slots of the group"
    return found[:, 8 : 8 + GROUP_SIZE]


def test_gathers_relative_motion_and_sum_of_surface_velocities():
    body, first, second = contacts()
    found = gathered(gather, body, first, second, num_quantities=9)
    i, j = body[first[4:]], body[second[4:]]
    expected = np.zeros((9, GROUP_SIZE))
    displacement, velocity = vector(DISPLACEMENT), vector(VELOCITY)
    surface_velocity = vector(SURFACE_VELOCITY)
    expected[vector(RELATIVE_DISPLACEMENT)] = (j - i)[:, displacement].T
    expected[vector(RELATIVE_VELOCITY)] = (j - i)[:, velocity].T
    expected[vector(SURFACE_VELOCITY_SUM)] = (i + j)[:, surface_velocity].T
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_gathers_relative_velocity_and_sums_of_inverse_masses_and_radii():
    body, first, second = contacts()
    found = gathered(gather_closing, body, first, second, num_quantities=5)
    i, j = body[first[4:]], body[second[4:]]
    velocity = vector(VELOCITY)
    np.testing.assert_array_equal(found[vector(CLOSING_VELOCITY)], (j - i)[:, velocity].T)
    np.testing.assert_array_equal(found[INVERSE_MASS_SUM], (i + j)[:, INVERSE_MASS])
    np.testing.assert_array_equal(found[CONTACT_RADIUS_SUM], (i + j)[:, CONTACT_RADIUS])


def test_gathers_separations_rounded_after_the_subtraction():
    _, first, second = contacts()
    position = 1e5 + np.random.default_rng(4).normal(size=(6, 3))
    found = gathered(gather_vectors, position, first, second, num_quantities=3)
    expected = (position[second[4:]] - position[first[4:]]).astype(np.float32)
    np.testing.assert_array_equal(found, expected.T)


def test_scatters_to_both_bodies_where_contacts_share_one():
    body, first, second = contacts()
    scratch = np.random.default_rng(2).normal(size=(7, STRIDE)).astype(np.float32)
    sums = np.random.default_rng(3).normal(size=(6, FORCE_RECORD_SIZE)).astype(np.float32)
    expected = sums.astype(np.float64)
    for slot, (i, j) in enumerate(
        zip(first[:GROUP_SIZE], second[:GROUP_SIZE], strict=True), start=4
    ):
        limit = scratch[ROLLING_LIMIT, slot]
        for own, other, sign in ((i, j, -1.0), (j, i, 1.0)):
            expected[own, vector(FORCE_SUM)] += sign * scratch[vector(FORCE), slot]
            expected[own, ROLLING_LIMIT_SUM] += limit
            expected[own, vector(TORQUE_SUM)] += scratch[vector(TORQUE_OVER_RADIUS), slot]
            expected[own, vector(LIMIT_WEIGHTED_ANGULAR_VELOCITY)] += (
                limit * body[other, vector(ANGULAR_VELOCITY)]
            )
    scatter(body, sums, first, second, 0, scratch.reshape(-1), 4)
    np.testing.assert_allclose(sums, expected, rtol=1e-5, atol=1e-5)


def test_gathers_and_adds_to_bodies_in_contact_with_something_at_rest():
    body, row, _ = contacts()
    found = gathered(gather_one, body, row, num_quantities=9)
    own = body[row[4:]]
    for quantity, column in (
        (RELATIVE_DISPLACEMENT, DISPLACEMENT),
        (RELATIVE_VELOCITY, VELOCITY),
        (SURFACE_VELOCITY_SUM, SURFACE_VELOCITY),
    ):
        np.testing.assert_array_equal(found[vector(quantity)], own[:, vector(column)].T)

    scratch = np.random.default_rng(2).normal(size=(7, STRIDE)).astype(np.float32)
    sums = np.random.default_rng(3).normal(size=(6, FORCE_RECORD_SIZE)).astype(np.float32)
    expected = sums.astype(np.float64)
    for slot, i in enumerate(row[:GROUP_SIZE], start=4):  # three of them are the same body
        expected[i, vector(FORCE_SUM)] += scratch[vector(FORCE), slot]
        expected[i, ROLLING_LIMIT_SUM] += scratch[ROLLING_LIMIT, slot]
        expected[i, vector(TORQUE_SUM)] += scratch[vector(TORQUE_OVER_RADIUS), slot]
    add_to_one(sums, row, 0, scratch.reshape(-1), 4)
    np.testing.assert_allclose(sums, expected, rtol=1e-5, atol=1e-5)


def test_gathers_columns_and_scatters_whole_records():
    body, _, row = contacts()
    records = body.copy()
    records[:, DISPLACEMENT + 1] = 0.0  # the column that is not gathered
    scratch = np.zeros(BODY_RECORD_SIZE * STRIDE, np.float32)
    gather_columns(body, row, 1, scratch, 4)
    found = scratch.reshape(BODY_RECORD_SIZE, STRIDE)
    np.testing.assert_array_equal(found[:, 4:8], records[row[1:5]].T)
    outside = np.delete(found, slice(4, 8), axis=1)
    assert not outside.any(), "written outside the slots of the group"
    copy = np.zeros_like(body)
    scatter_all_columns(copy, row, 1, scratch, 4)
    expected = np.zeros_like(body)
    expected[row[1:5]] = records[row[1:5]]
    np.testing.assert_array_equal(copy, expected)
