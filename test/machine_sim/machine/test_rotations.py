"""Rotation matrices and quaternions."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from machine_sim.machine.rotations import (
    quaternion_from_matrix,
    rotation_from_rpy,
    rotation_matrix,
    rpy_from_rotation,
)

QUATERNIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@settings(max_examples=100, deadline=None)
@given(QUATERNIONS)
def test_roll_pitch_yaw_give_the_rotation_again(quaternion):
    rotation = rotation_matrix(quaternion)
    rpy = rpy_from_rotation(rotation)
    np.testing.assert_allclose(rotation_from_rpy(rpy), rotation, atol=1e-8)


def test_rotations_about_fixed_axes_are_made_in_the_order_x_y_z():
    # About x: y becomes z. About z then: z stays, and x becomes y.
    rotation = rotation_from_rpy((np.pi / 2, 0.0, np.pi / 2))
    np.testing.assert_allclose(rotation @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(rotation @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


@settings(max_examples=100, deadline=None)
@given(QUATERNIONS)
def test_quaternion_from_matrix_inverts_rotation_matrix(quaternion):
    rotation = rotation_matrix(np.array(quaternion) / np.linalg.norm(quaternion))
    np.testing.assert_allclose(
        rotation_matrix(quaternion_from_matrix(rotation)), rotation, atol=1e-12
    )
