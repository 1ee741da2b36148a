"""Angles reproduce their rotation, also where they are ambiguous."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.wire import raises

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.rotations import rotation_matrix, unit_quaternion, yaw_pitch_roll
from msg_bridge.contract.errors import ErrorCode

ANGLES = st.floats(-3.1, 3.1)


def about(axis, angle):
    """Return the rotation about a coordinate axis, by index."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[j, j] = turn[k, k] = math.cos(angle)
    turn[k, j] = math.sin(angle)
    turn[j, k] = -turn[k, j]
    return turn


def composed(yaw, pitch, roll):
    return about(2, yaw) @ about(1, pitch) @ about(0, roll)


@given(ANGLES, st.floats(-1.5, 1.5), ANGLES)
def test_angles_of_a_rotation(yaw, pitch, roll):
    assert yaw_pitch_roll(composed(yaw, pitch, roll)) == pytest.approx(
        (yaw, pitch, roll), abs=1e-12
    )


@given(ANGLES, st.sampled_from([0.0, 1e-17, 1e-12, 1e-9, 1e-8, 1e-5]), ANGLES, st.booleans())
def test_angles_reproduce_a_rotation_with_a_pitch_of_90_degrees(yaw, off, roll, up):
    rotation = composed(yaw, (off - 0.5 * math.pi) * (1 if up else -1), roll)
    np.testing.assert_allclose(composed(*yaw_pitch_roll(rotation)), rotation, atol=1e-14)


def test_quaternion_rotates_about_its_axis():
    half = 0.5 * 0.7
    for axis in range(3):
        parts = [0.0, 0.0, 0.0, 5.0 * math.cos(half)]  # of any length
        parts[axis] = 5.0 * math.sin(half)
        np.testing.assert_allclose(rotation_matrix(parts), about(axis, 0.7), atol=1e-15)
        assert np.linalg.norm(unit_quaternion(parts)) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("parts", [[0.0] * 4, [1.0] * 3, [math.inf, 0.0, 0.0, 1.0]])
def test_invalid_quaternion_is_rejected(parts):
    with raises(ErrorCode.VALUE, CodecError):
        rotation_matrix(parts)
