"""Observation: strips of terrain; BaseFilter: the low-pass filter of the base pose."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.operator_scenes import observation, tilted

from dig_operator.observation import BaseFilter

DT = 0.02
TIME_CONSTANT = 1.5
RADIUS = np.linspace(2.0, 8.0, 13)


def nose_down_angle(rotation) -> float:
    """Return the angle of the base's x axis below the horizontal [rad]."""
    return float(-np.arcsin(rotation[2, 0]))


@pytest.mark.parametrize("azimuth", [0.0, 0.7, -2.0])
def test_mean_heights_across_a_plane_are_those_of_the_centre_line(azimuth):
    observed = observation(surface=lambda x, y: 0.2 * x - 0.1 * y, position=(1.0, -1.5, 0.0))
    x, y = 1.0 + RADIUS * np.cos(azimuth), -1.5 + RADIUS * np.sin(azimuth)
    np.testing.assert_allclose(
        observed.mean_strip_heights(azimuth, RADIUS, 1.2), 0.2 * x - 0.1 * y, atol=1e-9
    )


def test_strip_heights_are_averaged_across_its_width():
    observed = observation(surface=lambda x, y: np.abs(y))
    narrow, wide = (observed.mean_strip_heights(0.0, RADIUS, width) for width in (0.4, 2.0))
    assert narrow == pytest.approx(0.12)
    assert wide == pytest.approx(0.6)


def test_terrain_beyond_the_map_is_level():
    observed = observation(surface=lambda x, y: x)
    assert observed.surface_heights(np.array([50.0]), np.zeros(1)) == pytest.approx(
        observed.grid.x_first
    )


def test_yaw_is_the_heading_of_the_base():
    assert observation(rotation=tilted(roll=0.1, pitch=0.1, yaw=2.0)).yaw == pytest.approx(2.0)


def test_observation_with_another_base_differs_only_in_that():
    first = observation(position=(1.0, 2.0, 3.0), rotation=tilted(pitch=0.1), fill=0.7)
    moved = first.with_base(np.zeros(3), np.eye(3))
    expected = replace(first, base_position=moved.base_position, base_rotation=moved.base_rotation)
    assert vars(moved) == vars(expected)
    assert first.base_position.tolist() == [1.0, 2.0, 3.0]


def test_first_pose_passes_unfiltered():
    first = observation(position=(1.0, 2.0, 3.0), rotation=tilted(pitch=0.1, yaw=1.0))
    observed = BaseFilter(TIME_CONSTANT).update(first, DT)
    np.testing.assert_allclose(observed.base_position, first.base_position)
    np.testing.assert_allclose(observed.base_rotation, first.base_rotation, atol=1e-12)


def test_rocking_is_suppressed():
    base_filter = BaseFilter(TIME_CONSTANT)
    base_filter.update(observation(), DT)
    angles = 0.05 * np.sin(2 * np.pi * np.arange(0.0, 0.5, DT) / 0.5)
    filtered = [
        nose_down_angle(base_filter.update(observation(rotation=tilted(pitch=a)), DT).base_rotation)
        for a in angles
    ]
    assert np.abs(filtered).max() < 0.25 * 0.05


def test_lasting_tilt_is_followed():
    base_filter = BaseFilter(TIME_CONSTANT)
    base_filter.update(observation(), DT)
    tilted_base = observation(position=(0.0, 0.0, -0.1), rotation=tilted(pitch=0.05))
    for _ in range(round(4 * TIME_CONSTANT / DT)):
        observed = base_filter.update(tilted_base, DT)
    assert nose_down_angle(observed.base_rotation) == pytest.approx(0.05, rel=0.03)
    assert observed.base_position[2] == pytest.approx(-0.1, rel=0.03)


def test_step_response_after_one_time_constant_is_63_percent():
    base_filter = BaseFilter(TIME_CONSTANT)
    base_filter.update(observation(), DT)
    for _ in range(round(TIME_CONSTANT / DT)):
        observed = base_filter.update(observation(rotation=tilted(pitch=0.05)), DT)
    assert nose_down_angle(observed.base_rotation) == pytest.approx(
        (1 - np.exp(-1)) * 0.05, rel=0.03
    )


def test_step_longer_than_the_time_constant_does_not_overshoot():
    base_filter = BaseFilter(0.01)
    base_filter.update(observation(), DT)
    observed = base_filter.update(observation(rotation=tilted(pitch=0.05)), 10.0)
    assert nose_down_angle(observed.base_rotation) == pytest.approx(0.05)


ANGLES = st.lists(st.tuples(*[st.floats(-0.4, 0.4)] * 3), min_size=2, max_size=12)


@settings(max_examples=100, deadline=None)
@given(ANGLES)
def test_filtered_rotation_is_a_rotation(angles):
    base_filter = BaseFilter(0.1)
    for roll, pitch, yaw in angles:
        m = base_filter.update(
            observation(rotation=tilted(roll=roll, pitch=pitch, yaw=yaw)), DT
        ).base_rotation
        np.testing.assert_allclose(m @ m.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(m) == pytest.approx(1.0)


def test_filter_changes_only_the_base_pose():
    first = observation([0.1, 0.2, 0.9, 0.4], fill=0.7, time=3.0)
    observed = BaseFilter(TIME_CONSTANT).update(first, DT)
    assert (observed.time, observed.fill) == (3.0, 0.7)
    assert observed.joints is first.joints
    assert observed.elevation is first.elevation
