"""Large failures are relaxed in windows: exact, and with the result of relaxing cell by cell."""

from __future__ import annotations

import numpy as np
import pytest
from support.soil_scenes import NO_DEPOSIT_REQUESTS, NO_SWEEPS, come_to_rest, make_deposit_requests

from msg_bridge.contract.grid import Grid
from soil_sim.slope_failure import gauss_circle_offsets
from soil_sim.slope_failure.relax_pairs import pair_directions, relax_passes
from soil_sim.slope_failure.retained_pairs import RetainedPairs
from soil_sim.slope_failure.window_surface import WALL, WindowSurface, padded_cols
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

GRID = Grid(121, 101, 0.2)


def trench(params: SoilParams, **layers: np.ndarray) -> Soil:
    """Return a trench 2 m deep, 3 m wide and 16 m long, with vertical walls."""
    heights = np.zeros(GRID.shape)
    heights[20:100, 42:57] = -2.0
    soil = Soil(GRID, heights, params, **layers)
    soil.relaxation.mark_all_disturbed()
    return soil


@pytest.mark.parametrize("params", [SoilParams(), SoilParams(soil="gravel")])
def test_walls_of_a_trench_fail_to_their_angle_of_repose_and_keep_their_volume(
    params: SoilParams,
) -> None:
    soil = trench(params)
    before = soil.columns.total_mm3
    come_to_rest(soil)
    assert soil.relaxation.num_window_passes > 3
    assert soil.columns.total_mm3 == before
    assert soil.relaxation.max_slope_excess() <= 2 * params.relaxation_tolerance
    assert soil.columns.height[60, 44] > -1.5
    assert (soil.columns.bulk >= soil.columns.loose).all()
    assert soil.columns.loose.min() >= 0


def test_windows_and_single_cells_end_in_similar_slopes() -> None:
    heights = []
    for uses_windows in (True, False):
        soil = trench(SoilParams(repose_angle=33.0, swell=0.1))
        soil.relaxation.uses_windows = uses_windows
        heights.append(come_to_rest(soil).columns.height)
        assert (soil.relaxation.num_window_passes > 0) == uses_windows
    difference = np.abs(heights[0] - heights[1])
    assert difference.max() < 0.25
    assert np.sqrt((difference[30:90, 30:70] ** 2).mean()) < 0.04


def test_trench_fails_symmetrically() -> None:
    soil = come_to_rest(trench(SoilParams()))
    across = soil.columns.height[40:80, 30:69].mean(axis=0)
    np.testing.assert_allclose(across, across[::-1], atol=0.03)
    assert soil.relaxation.num_window_passes > 0


def test_large_failure_is_spread_over_ticks() -> None:
    soil = trench(SoilParams(max_cell_visits_per_tick=2000))
    total, ticks = soil.columns.total_mm3, 0
    while soil.relaxation.num_pending:
        soil.step(ticks, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        assert soil.verify_volume()
        assert soil.total_mm3 == total
        ticks += 1
    assert ticks > 5
    assert soil.relaxation.max_slope_excess() <= 0.004


def test_soil_deposited_during_a_large_failure_takes_part_in_it() -> None:
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


def test_occupied_columns_neither_give_nor_receive_soil() -> None:
    soil = trench(SoilParams())
    soil.relaxation.occupied[50:70, 36:42] = 1
    before = soil.columns.firm + soil.columns.loose
    come_to_rest(soil)
    after = soil.columns.firm + soil.columns.loose
    assert (after[50:70, 36:42] == before[50:70, 36:42]).all()
    assert soil.relaxation.num_window_passes > 0


@pytest.mark.parametrize(("axis", "min_shares"), [(0, (0.97, 0.97)), (1, (0.95, 0.85))])
def test_soil_comes_to_rest_on_that_side_where_it_failed(
    axis: int, min_shares: tuple[float, float]
) -> None:
    """Damp gravel meets dry sand in the middle, along a trench or across it."""
    middle = 60 if axis == 0 else 49
    ids = np.zeros(GRID.shape, dtype=np.uint8)
    np.moveaxis(ids, axis, 0)[middle:] = 1
    params = SoilParams(soil="gravel", additional_soils=("dry sand",))
    soil = trench(params, soil=ids, moisture=np.where(ids == 0, 30, 0))
    before = soil.total_mm3
    come_to_rest(soil)
    columns = soil.columns
    assert soil.relaxation.num_window_passes > 3
    assert soil.total_mm3 == columns.total_mm3 == before
    assert soil.relaxation.max_slope_excess() <= 0.004
    loose, moisture, kind = (
        np.moveaxis(layer, axis, 0).astype(float)
        for layer in (columns.loose, columns.loose_moisture, columns.loose_soil)
    )
    sand = 1.0 - moisture / 30.0  # share of the sand in the loose soil
    for part, share, min_share in zip(
        (np.s_[: middle - 4], np.s_[middle + 4 :]), (1.0 - sand, sand), min_shares, strict=True
    ):
        assert (loose * share)[part].sum() > min_share * loose[part].sum() > 5e9
    assert np.corrcoef(kind[loose > 0], sand[loose > 0])[0, 1] > 0.9


@pytest.mark.parametrize("case", ["moisture", "noise"])
def test_ground_whose_angle_of_repose_varies_is_relaxed_in_windows(case: str) -> None:
    moisture = np.random.default_rng(1).integers(0, 21, GRID.shape, dtype=np.uint8)
    if case == "moisture":
        soil = trench(SoilParams(soil="dry sand"), moisture=moisture)
    else:
        soil = trench(SoilParams(soil="dry sand", repose_angle_noise=4.0))
    before = soil.total_mm3
    come_to_rest(soil)
    assert soil.relaxation.num_window_passes > 3
    assert soil.columns.total_mm3 == before
    assert soil.relaxation.max_slope_excess() <= 0.004


@pytest.mark.parametrize("is_uniform", [False, True])
def test_passes_leave_no_pair_too_steep(is_uniform: bool) -> None:
    rng = np.random.default_rng(3)
    heights = rng.uniform(0.0, 3.0, (23, 40)).astype(np.float32)
    heights[9:12, 10:30] = 9.0
    tangents = rng.uniform(0.3, 0.9, heights.shape).astype(np.float32)
    if is_uniform:
        tangents[:] = 0.6
    neighbours, tolerance, total = gauss_circle_offsets(4.0), 0.001, float(heights.sum())
    surface = make_surface(heights, tangents, is_uniform=is_uniform)
    directions = pair_directions(neighbours, 0.2, tolerance, is_uniform=is_uniform)
    starts = np.zeros(2 * len(directions.offsets) + 1, dtype=np.int64)
    no_walls = RetainedPairs(np.zeros((0, 2), dtype=np.int64), starts)
    at_once, one_by_one = surface.heights.copy(), surface.heights.copy()
    is_moving, num_passes = relax_passes(at_once, surface, directions, no_walls, 0, 400)
    assert not is_moving
    for n in range(num_passes):  # one pass in each call: no pair of rows is skipped
        relax_passes(one_by_one, surface, directions, no_walls, n, 1)
    assert np.array_equal(one_by_one, at_once, equal_nan=True)
    for is_bottomless in (True, False):  # with a layer of tangents, and of a floor reached nowhere
        layered = surface._replace(is_uniform=False, is_bottomless=is_bottomless)
        relax_passes(one_by_one := surface.heights.copy(), layered, directions, no_walls, 0, 400)
        assert np.array_equal(one_by_one, at_once, equal_nan=True)
    assert np.isnan(at_once[:, 40:]).all()
    after = at_once[:, :40]
    assert float(after.sum()) == pytest.approx(total, rel=1e-5)
    for di, dj in neighbours:
        distance = 0.2 * np.hypot(di, dj)
        inside = np.s_[4:-4, 4:-4]
        beside = np.roll(after, (-di, -dj), axis=(0, 1))
        excess = (after - beside - tangents * distance)[inside]
        assert excess.max() <= 1.01 * tolerance, (di, dj)


def make_surface(heights: np.ndarray, tangents: np.ndarray, *, is_uniform: bool) -> WindowSurface:
    """Return the surface of a window without tools or firm soil, shape (rows, cols)."""
    cols = heights.shape[1]
    padding = ((0, 0), (0, padded_cols(cols, 4) - cols))
    return WindowSurface(
        np.pad(heights, padding, constant_values=WALL),
        np.pad(np.zeros_like(heights), padding),
        np.pad(tangents, padding),
        cols,
        tangents[-1, -1],
        is_uniform=is_uniform,
        is_bottomless=True,
        is_transposed=False,
    )


def test_stable_wall_of_clay_does_not_fail() -> None:
    soil = come_to_rest(trench(SoilParams(soil="dry clay")))
    assert soil.columns.loose.sum() == 0
    assert (soil.columns.height[20:100, 42:57] < -1.99).all()


def test_large_failure_is_reproducible() -> None:
    hashes = set()
    for _ in range(2):
        soil = trench(SoilParams(max_cell_visits_per_tick=3000))
        while soil.relaxation.num_pending:
            soil.step(0, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        hashes.add(soil.state_hash())
    assert len(hashes) == 1


def test_pair_directions_have_no_opposite_and_no_parallel_ones() -> None:
    directions = pair_directions(gauss_circle_offsets(4.0), 0.2, 0.0004)
    offsets = {tuple(offset) for offset in directions.offsets.tolist()}
    assert len(offsets) == 16
    assert all((-di, -dj) not in offsets for di, dj in offsets)
    assert {(1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (3, 2), (1, 3)} <= offsets
    assert (2, 0) not in offsets, "parallel to (1, 0)"
