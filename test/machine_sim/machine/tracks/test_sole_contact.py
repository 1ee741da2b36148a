"""Pressure of the tracks on the ground, from the loads of their shoes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.machine_scenes import excavator

from machine_sim.machine.tracks.track_model import SoleContact, sole_contact
from machine_sim.machine.tracks.track_state import SHOE_X

SPEC = excavator()
NUM_SHOES = 20
LENGTH = SPEC.tracks.axle_distance
X = LENGTH * ((np.arange(NUM_SHOES) + 0.5) / NUM_SHOES - 0.5)
AREA = LENGTH * SPEC.tracks.shoe_width


def contact_with(left: np.ndarray, right: np.ndarray) -> SoleContact:
    """Return the contact of shoes along the ground with loads [N], shape (NUM_SHOES,) each."""
    poses = np.zeros((2, NUM_SHOES, 3))
    poses[:, :, SHOE_X] = X
    tracks = SimpleNamespace(spec=SPEC, shoe_poses=poses, shoe_loads=np.stack([left, right]))
    return sole_contact(tracks)  # type: ignore[arg-type]


def test_pressure_has_the_load_and_the_moment_of_the_shoes() -> None:
    load = 80e3
    even = np.full(NUM_SHOES, load / NUM_SHOES)
    nose_heavy = even * (1.0 + 0.5 * X / (0.5 * LENGTH))
    found = contact_with(even, nose_heavy)
    mean = load / AREA
    assert found.front_pressures == pytest.approx((mean, 1.5 * mean), rel=0.01)
    assert found.rear_pressures == pytest.approx((mean, 0.5 * mean), rel=0.01)
    assert found.heights == pytest.approx((-0.5 * SPEC.tracks.shoe_thickness,) * 2)


def test_end_that_is_lifted_has_no_pressure() -> None:
    on_rear = np.where(X < -0.25 * LENGTH, 8e3, 0.0)
    found = contact_with(on_rear, np.zeros(NUM_SHOES))
    assert found.front_pressures == (0.0, 0.0)
    load, distance = on_rear.sum(), -(on_rear * X).sum() / on_rear.sum()
    contact_length = 3.0 * (0.5 * LENGTH - distance)
    expected = 2.0 * load / (contact_length * SPEC.tracks.shoe_width)
    assert found.rear_pressures == pytest.approx((expected, 0.0))
