"""Large failures: swept all at once, exact all the same, and at rest where examining would end."""

from __future__ import annotations

import numpy as np
import pytest
from support.soil_scenes import NO_DEPOSIT_REQUESTS, NO_SWEEPS, make_deposit_requests

import soil_sim.slope_failure.relaxation as slip_module
from msg_bridge.contract.grid import Grid
from soil_sim.slope_failure.relax_window import WindowRelaxation
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

GRID = Grid(121, 101, 0.2)


def trench(params: SoilParams, **layers: np.ndarray) -> Soil:
    """A trench 2 m deep, 3 m wide and 16 m long, dug in one go."""
    heights = np.zeros(GRID.shape)
    heights[20:100, 42:57] = -2.0
    soil = Soil(GRID, heights, params, **layers)
    soil.relaxation.mark_all_disturbed()
    return soil


def settled(soil: Soil) -> Soil:
    while soil.relaxation.relax(10**6):
        pass
    return soil


@pytest.fixture
def sweeps(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sweeps asked for in each call."""
    asked: list[int] = []
    relax = WindowRelaxation.relax

    def watched(self, bounds, waiting, occupied, max_passes):
        asked.append(max_passes)
        return relax(self, bounds, waiting, occupied, max_passes)

    monkeypatch.setattr(WindowRelaxation, "relax", watched)
    return asked


@pytest.mark.parametrize("params", [SoilParams(), SoilParams(soil="gravel")])
def test_a_trench_s_walls_come_down_to_their_angle_and_keep_every_mm3(
    params: SoilParams, sweeps: list[int]
) -> None:
    soil = trench(params)
    before = soil.columns.total_mm3
    settled(soil)
    assert len(sweeps) > 3
    assert soil.columns.total_mm3 == before
    assert soil.relaxation.max_slope_excess() <= 2 * params.relaxation_tolerance
    assert soil.columns.height[60, 44] > -1.5
    assert (soil.columns.bulk >= soil.columns.loose).all()
    assert soil.columns.loose.min() >= 0


def test_sweeping_ends_about_where_examining_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    swept = settled(trench(SoilParams(repose_angle=33.0, swell=0.1)))
    monkeypatch.setattr(slip_module, "_MIN_VISITS_FOR_WINDOW", 10**18)
    examined = settled(trench(SoilParams(repose_angle=33.0, swell=0.1)))
    apart = np.abs(swept.columns.height - examined.columns.height)
    assert apart.max() < 0.25
    assert np.sqrt((apart[30:90, 30:70] ** 2).mean()) < 0.04


def test_a_trench_stays_even_on_both_sides(sweeps: list[int]) -> None:
    soil = settled(trench(SoilParams()))
    across = soil.columns.height[40:80, 30:69].mean(axis=0)
    np.testing.assert_allclose(across, across[::-1], atol=0.03)
    assert sweeps


def test_a_collapse_is_spread_over_ticks_and_goes_on_in_the_next(sweeps: list[int]) -> None:
    soil = trench(SoilParams(max_cell_visits_per_tick=2000))
    total, ticks = soil.columns.total_mm3, 0
    while soil.relaxation.num_pending:
        soil.step(ticks, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        assert soil.verify_volume()
        assert soil.total_mm3 == total
        ticks += 1
    assert ticks > 5
    assert soil.relaxation.max_slope_excess() <= 0.004


def test_what_lands_in_the_midst_of_a_collapse_takes_part_in_it() -> None:
    soil = trench(SoilParams(max_cell_visits_per_tick=1000))
    before = soil.total_mm3
    for tick in range(5):
        rows = make_deposit_requests(np.zeros(20), np.zeros(20), 10_000_000)
        rows["particle_id"] += 100 * tick
        soil.step(tick, NO_SWEEPS, rows)
    while soil.relaxation.num_pending:
        soil.step(9, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    assert soil.total_mm3 == before + 100 * 10_000_000
    assert soil.relaxation.max_slope_excess() <= 0.004


def test_columns_that_are_held_stand_like_a_wall(sweeps: list[int]) -> None:
    soil = trench(SoilParams())
    soil.relaxation.occupied[50:70, 36:42] = 1
    before = soil.columns.firm + soil.columns.loose
    settled(soil)
    after = soil.columns.firm + soil.columns.loose
    assert (after[50:70, 36:42] == before[50:70, 36:42]).all()
    assert sweeps


def test_ground_of_several_kinds_is_examined_instead(sweeps: list[int]) -> None:
    ids = np.zeros(GRID.shape, dtype=np.uint8)
    ids[60:] = 1
    soil = settled(trench(SoilParams(soil="gravel", additional_soils=("dry sand",)), soil=ids))
    assert sweeps == []
    assert soil.relaxation.max_slope_excess() <= 0.004


def test_a_standing_wall_of_clay_is_left_standing(sweeps: list[int]) -> None:
    soil = settled(trench(SoilParams(soil="dry clay")))
    assert soil.columns.loose.sum() == 0
    assert (soil.columns.height[20:100, 42:57] < -1.99).all()


def test_equal_collapses_end_in_equal_states() -> None:
    hashes = set()
    for _ in range(2):
        soil = trench(SoilParams(max_cell_visits_per_tick=3000))
        while soil.relaxation.num_pending:
            soil.step(0, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        hashes.add(soil.state_hash())
    assert len(hashes) == 1


def test_no_column_is_in_two_pairs_of_a_direction_at_a_time() -> None:
    collapse = Soil(GRID, np.zeros(GRID.shape)).relaxation._window_relaxation
    steps = {tuple(step) for step in collapse._directions.tolist()}
    assert len(steps) == collapse.num_directions == 16
    assert all((-di, -dj) not in steps for di, dj in steps)
    assert {(1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (3, 2), (1, 3)} <= steps
    assert (2, 0) not in steps, "(1, 0) does it"
