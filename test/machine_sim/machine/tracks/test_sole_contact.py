"""Pressure of the tracks on the ground, from the loads of their shoes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.machine_scenes import excavator

from machine_sim.machine.tracks.track_model import ShoeTable, SoleContact, sole_contact
from machine_sim.machine.tracks.track_state import SHOE_X, SHOE_Z

SPEC = excavator()
NUM_SHOES = 20
LENGTH = SPEC.tracks.axle_distance
X = LENGTH * ((np.arange(NUM_SHOES) + 0.5) / NUM_SHOES - 0.5)
AREA = LENGTH * SPEC.tracks.shoe_width


def contact_with(left: np.ndarray, right: np.ndarray, z: float = 0.0) -> SoleContact:
    """Return the contact of shoes at a height [m] with loads [N], shape (NUM_SHOES,) each."""
    poses = np.zeros((2, NUM_SHOES, 3))
    poses[:, :, SHOE_X], poses[:, :, SHOE_Z] = X, z
    tracks = SimpleNamespace(spec=SPEC, shoe_poses=poses, shoe_loads=np.stack([left, right]))
    found: SoleContact = sole_contact(ShoeTable.of(tracks))  # type: ignore[arg-type]
    return found


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


def test_track_that_lies_on_its_upper_run_has_no_loaded_soles() -> None:
    load = np.full(NUM_SHOES, 4e3)
    upper_run = SPEC.tracks.axle_height + SPEC.tracks.sprocket_radius
    on_upper_run, lifted = contact_with(load, load, upper_run), contact_with(0 * load, 0 * load)
    assert on_upper_run == lifted
