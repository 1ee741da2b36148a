"""Failures, deposits and moisture have an effect only near where they occur."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.soil_scenes import (
    NO_SWEEPS,
    come_to_rest,
    flat_soil,
    make_deposit_requests,
    reference_soil,
)

from msg_bridge.contract.grid import Grid
from soil_sim.columns.operations import remove_loose
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams


def test_soil_of_one_failure_is_not_deposited_at_another() -> None:
    """A firm block and a loose heap, 12 m apart on level ground, fail at once."""
    grid = Grid(161, 161, 0.2)
    heights = np.zeros(grid.shape)
    heights[20:50, 20:140] = 3.0
    soil = Soil(grid, heights, reference_soil(swell=0.4))
    columns = soil.columns
    bulk = int(3.0 / columns.metres_per_mm3)
    columns.bulk[110:140, 20:140] = bulk
    columns.loose[110:140, 20:140] = int(bulk / 1.4)
    columns.height[110:140, 20:140] += 3.0
    columns.moisture[:80] = 100
    volume = int((columns.firm + columns.loose)[:80].sum())
    soil.relaxation.mark_all_disturbed()
    come_to_rest(soil)
    assert (columns.loose[72:88] == 0).all(), "no soil crossed the middle"
    assert int((columns.firm + columns.loose)[:80].sum()) == volume
    assert set(columns.moisture[:72].flat) == {100}
    assert set(columns.moisture[88:].flat) == {0}


def test_small_deposit_of_dry_sand_does_not_make_a_damp_slope_fail() -> None:
    """5 litres of dry sand (34 degrees) on firm damp sand at 40 degrees, which stands at 45."""
    grid = Grid(41, 41, 0.2)
    fall = math.tan(math.radians(40.0)) * grid.cell
    heights = np.tile(-fall * np.arange(41.0), (41, 1))
    soil = Soil(grid, heights, SoilParams(soil="dry sand", moisture=50))
    firm = soil.columns.firm.copy()
    for tick in range(5):
        soil.step(tick, NO_SWEEPS, make_deposit_requests(grid.x(20.0), grid.y(10.0), 1_000_000))
    come_to_rest(soil)
    assert int((firm - soil.columns.firm).sum()) == 0


def test_firm_soil_keeps_its_moisture_under_dry_loose_soil() -> None:
    soil = flat_soil(6.0, 0.2, soil="wet clay")
    columns = soil.columns
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, 4_000_000))  # dry
    for cell in np.flatnonzero(columns.loose):
        remove_loose(columns.arrays, cell, int(columns.loose.flat[cell]))
    assert set(columns.moisture.flat) == {100}


@pytest.mark.parametrize("volume", [0.2, 2.4])
def test_heap_deposited_at_once_at_one_point_is_a_cone(volume: float) -> None:
    soil = flat_soil(9.0, 0.1)
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, int(volume * 1e9)))
    come_to_rest(soil)
    cone = (3 * volume * math.tan(math.radians(30.0)) ** 2 / math.pi) ** (1 / 3)
    assert soil.columns.height.max() == pytest.approx(cone, rel=0.05)


def test_tolerance_is_at_least_a_few_mm3() -> None:
    soil = flat_soil(0.4, 0.01, relaxation_tolerance=1e-5)
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, 100_000))
    come_to_rest(soil)
    assert soil.relaxation.max_slope_excess() <= 4 * soil.columns.metres_per_mm3 / soil.grid.cell
