"""Rock yields to the work of cutting only, and other soil to any part of a tool."""

import numpy as np
import pytest
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    bucket_sweep,
    come_to_rest,
    excavated_mm3,
    flat_soil,
    make_deposit_requests,
)

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import SoilReaction
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.tool_force.specific_energy import rock_specific_energy

ROCK_ENERGY = rock_specific_energy(3e6)
PRESS = bucket_sweep((0, 0, 0.02), (0, 0, -0.1))
"""A bucket that is pressed straight down."""


def test_bucket_pressed_down_on_rock_removes_none() -> None:
    soil = flat_soil(6.0, 0.2, soil="rock")
    assert excavated_mm3(soil.step(0, PRESS, NO_DEPOSIT_REQUESTS)) == 0
    assert (soil.columns.height == 0.0).all()


@pytest.mark.parametrize("depth", [0.01, 0.05])
def test_teeth_remove_the_rock_that_the_work_of_their_force_covers(depth) -> None:
    soil = flat_soil(6.0, 0.2, soil="rock")
    step = soil.step(0, bucket_sweep((0, 0, -depth), (0.01, 0, -depth)), NO_DEPOSIT_REQUESTS)
    (cut,) = step.forces[step.forces["reaction"] == SoilReaction.CUT]
    assert cut["fx"] < 0.0
    assert excavated_mm3(step) / 1e9 == pytest.approx(-cut["fx"] * 0.01 / ROCK_ENERGY, rel=1e-3)
    assert soil.verify_volume()


def test_rock_that_stays_is_removed_by_the_work_of_the_next_ticks() -> None:
    soil = flat_soil(6.0, 0.2, soil="rock")
    removed = [
        excavated_mm3(soil.step(tick, sweep, NO_DEPOSIT_REQUESTS))
        for tick, sweep in enumerate([bucket_sweep((-0.01, 0, -0.1), (0, 0, -0.1))] * 2)
    ]
    assert removed[1] > 0.5 * removed[0] > 0
    assert soil.verify_volume()


def test_nothing_limits_the_cut_without_tool_forces() -> None:
    soil = flat_soil(6.0, 0.2, soil="rock", force_mode="none")
    other = flat_soil(6.0, 0.2, soil="gravel", force_mode="none")
    removed, expected = (
        excavated_mm3(each.step(0, PRESS, NO_DEPOSIT_REQUESTS)) for each in (soil, other)
    )
    assert removed == pytest.approx(expected, rel=1e-6)


def test_loose_soil_on_rock_is_removed_without_the_rock() -> None:
    soil = flat_soil(6.0, 0.2, soil="rock")
    soil.step(0, NO_SWEEPS, make_deposit_requests(-0.2, 0.0, 5_000_000))
    come_to_rest(soil)
    firm = soil.columns.firm.copy()
    loose = int(soil.columns.loose.sum())
    removed = excavated_mm3(soil.step(1, PRESS, NO_DEPOSIT_REQUESTS))
    assert 0.5 * loose < removed <= loose
    assert np.array_equal(soil.columns.firm, firm)


def test_soil_beside_rock_is_removed() -> None:
    grid = Grid(31, 31, 0.2)
    kinds = np.zeros(grid.shape, dtype=np.uint8)
    kinds[:, grid.y(np.arange(31)) > 0.0] = 1
    params = SoilParams(soil="loam", additional_soils=("rock",))
    soil = Soil(grid, np.zeros(grid.shape), params, soil=kinds)
    start = soil.columns.firm.copy()
    assert excavated_mm3(soil.step(0, PRESS, NO_DEPOSIT_REQUESTS)) > 0
    changed = soil.columns.firm != start
    assert changed[kinds == 0].any()
    assert not changed[kinds == 1].any()
