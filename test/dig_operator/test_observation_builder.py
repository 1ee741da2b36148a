"""ObservationBuilder: an observation from the messages of a tick, and motion of soil."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dig_operator.observation import Observation
from dig_operator.observation_builder import MachineSample, ObservationBuilder, TerrainSnapshot
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger

GRID = Grid(9, 9, 1.0)
HALF = math.sqrt(0.5)
BASE = BaseState((1.0, 2.0, 0.5), (0.0, 0.0, HALF, HALF), (9, 9, 9), (9, 9, 9))


def build(
    builder: ObservationBuilder, *, revision: int = 0, particles: int = 0, in_flight: int = 0
) -> Observation:
    terrain = TerrainSnapshot(GRID, np.full(GRID.shape, 0.25), revision)
    ledger = Ledger(1, 3, 10, in_flight, 0, particles, 0, 0, 10)
    payload = PayloadState(bank_m3=0.4, loose_m3=0.5, mass_kg=700.0, fill=0.6)
    return builder.build(1.5, MachineSample([0.1, 0.2, 0.3, 0.4], BASE, payload), terrain, ledger)


def test_observation_holds_the_values_of_the_messages() -> None:
    observation = build(ObservationBuilder())
    assert observation.time == 1.5
    assert observation.joints.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert observation.base_position.tolist() == [1.0, 2.0, 0.5]
    assert observation.yaw == pytest.approx(math.pi / 2)
    assert (observation.fill, observation.bank_m3) == (0.6, 0.4)
    assert observation.surface_heights(np.zeros(1), np.zeros(1)) == pytest.approx(0.25)


def test_unchanged_terrain_is_at_rest_from_the_second_observation_on() -> None:
    builder = ObservationBuilder()
    assert build(builder).is_soil_moving  # nothing to compare with
    assert not build(builder).is_soil_moving


def test_changed_terrain_is_moving() -> None:
    builder = ObservationBuilder()
    build(builder)
    assert build(builder, revision=1).is_soil_moving
    assert not build(builder, revision=1).is_soil_moving


@pytest.mark.parametrize("soil", [{"particles": 5}, {"in_flight": 5}, {"in_flight": -5}])
def test_soil_that_is_not_terrain_is_moving(soil: dict[str, int]) -> None:
    builder = ObservationBuilder()
    build(builder)
    assert build(builder, **soil).is_soil_moving
    assert not build(builder).is_soil_moving


def test_observation_copies_its_arrays() -> None:
    builder, joints = ObservationBuilder(), np.array([0.1, 0.2, 0.3, 0.4])
    terrain = TerrainSnapshot(GRID, np.zeros(GRID.shape), 0)
    ledger = Ledger(1, 3, 0, 0, 0, 0, 0, 0, 0)
    observation = builder.build(
        0.0, MachineSample(joints, BASE, PayloadState(0, 0, 0, 0)), terrain, ledger
    )
    joints[:] = 9.0
    assert observation.joints.tolist() == [0.1, 0.2, 0.3, 0.4]
