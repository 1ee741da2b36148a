"""What an operator sees, and how slowly it believes that the base has moved."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.operator_scenes import observation, tilted

from dig_operator.observation import BaseFilter

DT = 0.02
PATIENCE = 1.5
RADIUS = np.linspace(2.0, 8.0, 13)


def nose_down(rotation) -> float:
    """How far the base's x axis points below the horizontal [rad]."""
    return float(-np.arcsin(rotation[2, 0]))


@pytest.mark.parametrize("azimuth", [0.0, 0.7, -2.0])
def test_strip_on_a_sloped_plane_has_the_heights_of_its_middle(azimuth):
    seen = observation(surface=lambda x, y: 0.2 * x - 0.1 * y, position=(1.0, -1.5, 0.0))
    x, y = 1.0 + RADIUS * np.cos(azimuth), -1.5 + RADIUS * np.sin(azimuth)
    np.testing.assert_allclose(
        seen.mean_strip_heights(azimuth, RADIUS, 1.2), 0.2 * x - 0.1 * y, atol=1e-9
    )


def test_strip_is_averaged_across_its_width():
    seen = observation(surface=lambda x, y: np.abs(y))
    narrow, wide = (seen.mean_strip_heights(0.0, RADIUS, width) for width in (0.4, 2.0))
    assert narrow == pytest.approx(0.12)
    assert wide == pytest.approx(0.6)


def test_ground_beyond_the_map_goes_on_level():
    seen = observation(surface=lambda x, y: x)
    assert seen.surface_heights(np.array([50.0]), np.zeros(1)) == pytest.approx(seen.grid.x_first)


def test_yaw_is_where_the_base_faces():
    assert observation(rotation=tilted(roll=0.1, pitch=0.1, yaw=2.0)).yaw == pytest.approx(2.0)


def test_first_look_is_believed():
    first = observation(position=(1.0, 2.0, 3.0), rotation=tilted(pitch=0.1, yaw=1.0))
    seen = BaseFilter(PATIENCE).update(first, DT)
    np.testing.assert_allclose(seen.base_position, first.base_position)
    np.testing.assert_allclose(seen.base_rotation, first.base_rotation, atol=1e-12)


def test_a_short_rock_is_not_followed():
    eye = BaseFilter(PATIENCE)
    eye.update(observation(), DT)
    angles = 0.05 * np.sin(2 * np.pi * np.arange(0.0, 0.5, DT) / 0.5)
    followed = [
        nose_down(eye.update(observation(rotation=tilted(pitch=a)), DT).base_rotation)
        for a in angles
    ]
    assert np.abs(followed).max() < 0.25 * 0.05


def test_a_lasting_lean_is_followed():
    eye = BaseFilter(PATIENCE)
    eye.update(observation(), DT)
    lean = observation(position=(0.0, 0.0, -0.1), rotation=tilted(pitch=0.05))
    for _ in range(round(4 * PATIENCE / DT)):
        seen = eye.update(lean, DT)
    assert nose_down(seen.base_rotation) == pytest.approx(0.05, rel=0.03)
    assert seen.base_position[2] == pytest.approx(-0.1, rel=0.03)


def test_after_its_patience_most_of_a_lean_is_believed():
    eye = BaseFilter(PATIENCE)
    eye.update(observation(), DT)
    for _ in range(round(PATIENCE / DT)):
        seen = eye.update(observation(rotation=tilted(pitch=0.05)), DT)
    assert nose_down(seen.base_rotation) == pytest.approx((1 - np.exp(-1)) * 0.05, rel=0.03)


def test_a_tick_longer_than_its_patience_does_not_overshoot():
    eye = BaseFilter(0.01)
    eye.update(observation(), DT)
    seen = eye.update(observation(rotation=tilted(pitch=0.05)), 10.0)
    assert nose_down(seen.base_rotation) == pytest.approx(0.05)


ANGLES = st.lists(st.tuples(*[st.floats(-0.4, 0.4)] * 3), min_size=2, max_size=12)


@settings(max_examples=100, deadline=None)
@given(ANGLES)
def test_what_it_sees_is_always_a_rotation(angles):
    eye = BaseFilter(0.1)
    for roll, pitch, yaw in angles:
        m = eye.update(
            observation(rotation=tilted(roll=roll, pitch=pitch, yaw=yaw)), DT
        ).base_rotation
        np.testing.assert_allclose(m @ m.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(m) == pytest.approx(1.0)


def test_nothing_but_the_base_is_seen_differently():
    first = observation([0.1, 0.2, 0.9, 0.4], fill=0.7, time=3.0)
    seen = BaseFilter(PATIENCE).update(first, DT)
    assert (seen.time, seen.fill) == (3.0, 0.7)
    assert seen.joints is first.joints
    assert seen.elevation is first.elevation
