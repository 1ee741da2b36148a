"""ObservationBuilder: a view made of what topics told, and what moves in it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dig_operator.observation import Observation
from dig_operator.observation_builder import ObservationBuilder, TerrainSnapshot
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger

GRID = Grid(9, 9, 1.0)
HALF = math.sqrt(0.5)
BASE = BaseState((1.0, 2.0, 0.5), (0.0, 0.0, HALF, HALF), (9, 9, 9), (9, 9, 9))


def build(
    eyes: ObservationBuilder, *, revision: int = 0, particles: int = 0, in_flight: int = 0
) -> Observation:
    terrain = TerrainSnapshot(GRID, np.full(GRID.shape, 0.25), revision)
    ledger = Ledger(3, 10, in_flight, 0, particles, 0, 0, 10)
    payload = PayloadState(bank=0.4, loose=0.5, mass=700.0, fill=0.6)
    return eyes.build(1.5, [0.1, 0.2, 0.3, 0.4], BASE, payload, terrain, ledger)


def test_a_view_shows_what_was_told() -> None:
    observation = build(ObservationBuilder())
    assert observation.time == 1.5
    assert observation.joints.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert observation.base_position.tolist() == [1.0, 2.0, 0.5]
    assert observation.yaw == pytest.approx(math.pi / 2)
    assert (observation.fill, observation.bank) == (0.6, 0.4)
    assert observation.surface_heights(np.zeros(1), np.zeros(1)) == pytest.approx(0.25)


def test_ground_that_does_not_change_lies_still_from_the_second_look_on() -> None:
    eyes = ObservationBuilder()
    assert build(eyes).is_soil_moving  # it cannot know yet
    assert not build(eyes).is_soil_moving


def test_ground_that_changed_moves() -> None:
    eyes = ObservationBuilder()
    build(eyes)
    assert build(eyes, revision=1).is_soil_moving
    assert not build(eyes, revision=1).is_soil_moving


@pytest.mark.parametrize("soil", [{"particles": 5}, {"in_flight": 5}, {"in_flight": -5}])
def test_soil_that_is_not_terrain_yet_moves(soil: dict[str, int]) -> None:
    eyes = ObservationBuilder()
    build(eyes)
    assert build(eyes, **soil).is_soil_moving
    assert not build(eyes).is_soil_moving


def test_a_view_is_not_changed_by_what_is_told_later() -> None:
    eyes, joints = ObservationBuilder(), np.array([0.1, 0.2, 0.3, 0.4])
    terrain = TerrainSnapshot(GRID, np.zeros(GRID.shape), 0)
    ledger = Ledger(3, 0, 0, 0, 0, 0, 0, 0)
    observation = eyes.build(0.0, joints, BASE, PayloadState(0, 0, 0, 0), terrain, ledger)
    joints[:] = 9.0
    assert observation.joints.tolist() == [0.1, 0.2, 0.3, 0.4]
