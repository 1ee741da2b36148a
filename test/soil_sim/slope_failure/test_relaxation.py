"""Piles at rest, the edge of the map, swell, and the limit of work in a tick."""

import math

import numpy as np
import pytest
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    come_to_rest,
    contour_radii,
    flat_soil,
    make_deposit_requests,
    pour_pile,
)

from msg_bridge.contract.grid import Grid
from soil_sim.slope_failure import gauss_circle_offsets
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams


@pytest.mark.parametrize(
    ("radius_squared", "count"),
    [(1, 4), (2, 8), (4, 12), (5, 20), (8, 24), (9, 28), (10, 36), (13, 44), (16, 48)],
)
def test_neighbour_counts_are_those_of_the_gauss_circle(radius_squared: int, count: int) -> None:
    offsets = gauss_circle_offsets(math.sqrt(radius_squared))
    assert len(offsets) == count
    assert (np.sum(offsets**2, axis=1) <= radius_squared).all()


@pytest.fixture(scope="module", params=[(0.4, 30.0), (0.1, 30.0), (0.4, 34.0)])
def heap(request: pytest.FixtureRequest):
    cell, angle = request.param
    volume = 150.0 * (cell / 0.4) ** 3
    return pour_pile(cell, angle, volume), angle, volume


def test_pile_keeps_angle_of_repose(heap) -> None:
    soil, angle, _ = heap
    top = soil.columns.height.max()
    low, high = contour_radii(soil, 0.15 * top).mean(), contour_radii(soil, 0.75 * top).mean()
    assert math.degrees(math.atan(0.6 * top / (low - high))) == pytest.approx(angle, abs=0.5)


def test_pile_is_round(heap) -> None:
    soil, _, _ = heap
    radii = contour_radii(soil, 0.1 * soil.columns.height.max())
    assert radii.max() / radii.min() <= 1.03


def test_pile_has_the_height_of_a_cone_of_its_volume(heap) -> None:
    soil, angle, volume = heap
    cone = (3 * volume * math.tan(math.radians(angle)) ** 2 / math.pi) ** (1 / 3)
    assert soil.columns.height.max() == pytest.approx(cone, rel=0.02)


def test_no_slope_of_a_pile_exceeds_the_tolerance(heap) -> None:
    soil, _, _ = heap
    assert soil.relaxation.max_slope_excess() <= soil.params.relaxation_tolerance + 1e-9


def test_pile_does_not_drift(heap) -> None:
    soil, _, _ = heap
    height, n = soil.columns.height, soil.grid.rows
    weight = height / height.sum()
    middle = (n - 1) / 2
    assert (weight * (np.arange(n)[:, None] - middle)).sum() == pytest.approx(0, abs=0.05)
    assert (weight * (np.arange(n)[None, :] - middle)).sum() == pytest.approx(0, abs=0.05)


def test_relaxation_is_limited_per_tick_and_continues_in_the_next() -> None:
    soil = flat_soil(12.0, 0.2, max_cell_visits_per_tick=100)
    start = soil.total_mm3
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, 4_000_000_000))
    assert soil.relaxation.num_pending > 0
    assert soil.relaxation.max_slope_excess() > 0.1
    ticks = 0
    while soil.relaxation.num_pending:
        soil.step(ticks, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        ticks += 1
        assert soil.total_mm3 == start + 4_000_000_000
    assert ticks >= 3
    assert soil.relaxation.max_slope_excess() <= soil.params.relaxation_tolerance + 1e-9


def test_edge_of_the_map_is_a_closed_wall() -> None:
    soil = flat_soil(6.0, 0.2)
    start = soil.total_mm3
    for tick in range(200):
        soil.step(tick, NO_SWEEPS, make_deposit_requests(3.05, 3.05, 20_000_000))
    assert soil.total_mm3 == start + 200 * 20_000_000
    assert soil.verify_volume()
    assert soil.columns.height[0, 0] == soil.columns.height.max()


def test_soil_deposited_at_occupied_columns_moves_only_the_excess() -> None:
    soil = flat_soil(12.0, 0.2)
    soil.columns.firm[:20] += int(0.8 / soil.columns.metres_per_mm3)
    soil.columns.height[:20] += 0.8
    soil.relaxation.occupied[:20] = 1  # as columns a tool is in: they do not fail
    before = soil.columns.height.copy()
    soil.step(0, NO_SWEEPS, make_deposit_requests(soil.grid.x(21.0), 0.0, 8_000_000))
    moved = np.argwhere(soil.columns.height != before)
    assert 4 <= len(moved) <= 20
    assert (moved[:, 0] >= 20).all()


def test_loose_soil_has_its_swell() -> None:
    soil = flat_soil(12.0, 0.2, swell=0.25)
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, 400_000_000))
    come_to_rest(soil)
    bulk = soil.columns.height.sum() * soil.grid.cell**2
    assert bulk == pytest.approx(0.4 * 1.25, rel=1e-3)


def test_firm_soil_that_fails_swells_and_keeps_its_volume() -> None:
    soil = flat_soil(12.0, 0.2, swell=0.2)
    soil.columns.firm[25:35, 25:35] += int(1.5 / soil.columns.metres_per_mm3)
    soil.columns.height[25:35, 25:35] += 1.5
    total = soil.columns.total_mm3
    height = soil.columns.height.sum()
    soil.relaxation.mark_all_disturbed()
    soil.relaxation.relax()
    assert soil.columns.total_mm3 == total
    assert soil.columns.height.sum() > height
    assert soil.relaxation.max_slope_excess() <= soil.params.relaxation_tolerance + 1e-9


def test_map_smaller_than_the_relaxation_radius_comes_to_rest() -> None:
    grid = Grid(3, 2, 0.2)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(relaxation_radius=8.0))
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.2, 0.1, 4_000_000))
    assert soil.relaxation.num_pending == 0
    assert -1.0 < soil.relaxation.max_slope_excess() <= soil.params.relaxation_tolerance + 1e-9
