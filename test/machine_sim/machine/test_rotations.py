"""Rotation matrices and quaternions."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from machine_sim.machine.rotations import quaternion_from_matrix, rotation_matrix

QUATERNIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@settings(max_examples=100, deadline=None)
@given(QUATERNIONS)
def test_quaternion_from_matrix_inverts_rotation_matrix(quaternion):
    rotation = rotation_matrix(np.array(quaternion) / np.linalg.norm(quaternion))
    np.testing.assert_allclose(
        rotation_matrix(quaternion_from_matrix(rotation)), rotation, atol=1e-12
    )
