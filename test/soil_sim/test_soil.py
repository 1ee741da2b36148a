"""One tick of the soil: excavation, deposition, changed columns, state hash, invalid input."""

import numpy as np
import pytest
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    bucket_sweep,
    flat_soil,
    make_deposit_requests,
)

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import MAX_ROW_VOLUME, ConversionKind
from soil_sim.columns.operations import add_loose, remove_from_column
from soil_sim.errors import SoilError
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams


def test_deposit_is_divided_among_the_four_nearest_points() -> None:
    soil = flat_soil(6.0, 0.2, repose_angle=80.0)
    x, y = soil.grid.x(10.25), soil.grid.y(12.5)
    step = soil.step(0, NO_SWEEPS, make_deposit_requests(x, y, 1_000_003))
    cells = {(int(r["row"]), int(r["col"])) for r in step.map_updates}
    assert cells == {(10, 12), (10, 13), (11, 12), (11, 13)}
    loose = soil.columns.loose[10:12, 12:14]
    assert loose.sum() == 1_000_003
    shares = np.array([[0.375, 0.375], [0.125, 0.125]]) * 1_000_003
    assert np.abs(loose - shares).max() < 60  # the position in the row is a float32


def test_conversions_have_the_order_of_the_deposit_requests() -> None:
    soil = flat_soil(6.0, 0.2)
    rows = make_deposit_requests([0.0, 50.0, np.nan, 1.0], [0.0, 0.0, 0.0, 1.0], 500_000)
    rows["volume_mm3"][3] = 0
    conversions = soil.step(0, NO_SWEEPS, rows).conversions
    assert conversions["particle_id"].tolist() == [1, 2, 3, 4]
    assert conversions["kind"].tolist() == [
        ConversionKind.DEPOSIT,
        ConversionKind.OUTSIDE,
        ConversionKind.REJECT,
        ConversionKind.REJECT,
    ]
    assert soil.columns.loose.sum() == 500_000


def test_particle_requested_twice_in_a_tick_is_deposited_once() -> None:
    soil = flat_soil(6.0, 0.2)
    rows = make_deposit_requests([0.0, 1.0, 0.0, 2.0], [0.0, 1.0, 0.0, 0.0], 500_000)
    rows["particle_id"] = [7, 8, 7, 7]
    rows["machine_id"][3] = 2  # another machine's particle
    start = soil.total_mm3
    conversions = soil.step(0, NO_SWEEPS, rows).conversions
    assert conversions["kind"].tolist() == [
        ConversionKind.DEPOSIT,
        ConversionKind.DEPOSIT,
        ConversionKind.REJECT,
        ConversionKind.DEPOSIT,
    ]
    assert soil.total_mm3 == start + 3 * 500_000


@pytest.mark.parametrize("z", [np.nan, np.inf, -np.inf])
def test_particle_at_a_height_that_is_not_finite_is_rejected(z: float) -> None:
    soil = flat_soil(6.0, 0.2)
    rows = make_deposit_requests(0.0, 0.0, 500_000)
    rows["z"] = z
    step = soil.step(0, NO_SWEEPS, rows)
    assert step.conversions["kind"].tolist() == [ConversionKind.REJECT]
    assert step.map_updates.size == 0


def test_map_updates_are_the_columns_whose_volume_changed() -> None:
    soil = flat_soil(6.0, 0.2)
    before = soil.columns.firm + soil.columns.loose
    map_updates = soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, 50_000_000)).map_updates
    after = soil.columns.firm + soil.columns.loose
    is_updated = np.zeros(soil.grid.shape, dtype=bool)
    is_updated[map_updates["row"], map_updates["col"]] = True
    assert np.array_equal(is_updated, before != after)
    assert np.array_equal(map_updates["volume_mm3"], after[is_updated])
    assert map_updates["z"] == pytest.approx(soil.columns.height[is_updated])
    assert (map_updates["revision"] == 1).all()


@pytest.mark.parametrize("mode", ["swept", "reference"])
def test_cut_of_less_than_a_mm3_changes_nothing(mode: str) -> None:
    soil = flat_soil(6.0, 0.2, cut_mode=mode)
    soil.columns.height[:] += 2e-9  # 0.08 mm^3 of a column
    step = soil.step(0, bucket_sweep((0, 0, 0), (0, 0, 0)), NO_DEPOSIT_REQUESTS)
    assert step.conversions.size == 0
    assert step.map_updates.size == 0
    assert soil.revision == 0


def test_column_that_gives_away_what_it_received_has_not_changed() -> None:
    soil = flat_soil(6.0, 0.2)
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, 1000))
    add_loose(soil.columns.arrays, 40, 500, 500, 0, 0)
    remove_from_column(soil.columns.arrays, 40, 500.0)
    step = soil.step(1, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    assert step.map_updates.size == 0
    assert soil.revision == 1


def test_state_hash_is_reproducible_and_differs_by_one_mm3() -> None:
    hashes = []
    for extra in (0, 0, 1):
        soil = flat_soil(20.0, 0.2)
        soil.step(0, bucket_sweep((0, 0, 0.1), (0.1, 0, -0.3)), NO_DEPOSIT_REQUESTS)
        soil.step(1, NO_SWEEPS, make_deposit_requests(2.0, 3.0, 700_000 + extra))
        hashes.append(soil.state_hash())
    assert hashes[0] == hashes[1]
    assert hashes[0] != hashes[2]


def test_state_hash_changes_with_one_mm3() -> None:
    soil = flat_soil(20.0, 0.2)
    first = soil.state_hash()
    soil.step(0, NO_SWEEPS, make_deposit_requests(8.0, 8.0, 1))
    assert soil.state_hash() != first


def test_volume_too_large_for_a_row_is_split() -> None:
    grid = Grid(8, 8, 4.0)
    soil = Soil(grid, np.zeros(grid.shape))
    start = soil.total_mm3
    rows = soil.step(
        0, bucket_sweep((2, 0, 0.1), (2, 0, -4.0), width=12.0), NO_DEPOSIT_REQUESTS
    ).conversions
    assert (rows["volume_mm3"] == MAX_ROW_VOLUME).any()
    assert start - soil.total_mm3 == int(rows["volume_mm3"].astype(np.int64).sum())


def test_rows_of_any_memory_layout_give_the_same_terrain() -> None:
    sweeps = bucket_sweep((0.0, 0.0, -0.3), (0.2, 0.0, -0.3))
    requests = make_deposit_requests([1.0, 1.5], 0.0, 1_000_000)
    hashes = []
    for stride in (1, 2):
        soil = flat_soil(6.0, 0.2)
        soil.step(1, sweeps.repeat(stride)[::stride], requests.repeat(stride)[::stride])
        hashes.append(soil.state_hash())
    assert hashes[0] == hashes[1] != flat_soil(6.0, 0.2).state_hash()
    with pytest.raises(SoilError, match="1-D"):
        soil.step(2, sweeps[None], requests)


def test_heights_that_are_not_finite_are_rejected() -> None:
    heights = np.zeros((8, 8))
    heights[3, 4] = np.nan
    with pytest.raises(SoilError):
        Soil(Grid(8, 8, 1.0), heights)


def test_cell_below_a_centimetre_is_rejected() -> None:
    assert Grid(8, 8, 0.01).cell == 0.01
    with pytest.raises(ParameterError):
        Grid(8, 8, 0.009)


def test_map_whose_volume_would_overflow_is_rejected() -> None:
    grid = Grid(40, 40, 60.0)
    with pytest.raises(SoilError, match="smaller soil_depth, cell or map"):
        Soil(grid, np.zeros(grid.shape), SoilParams(soil_depth=1000.0))


def test_volume_of_the_largest_map_is_exact() -> None:
    grid = Grid(35, 35, 60.0)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil_depth=1000.0))
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, MAX_ROW_VOLUME))
    assert soil.total_mm3 == 35**2 * 60_000**2 * 1_000_000 + MAX_ROW_VOLUME
    assert soil.verify_volume()


def test_terrain_continues_with_other_parameters() -> None:
    before = flat_soil(6.0, 0.2, soil="loam")
    before.step(0, NO_SWEEPS, make_deposit_requests([0.0] * 100, [0.0] * 100, MAX_ROW_VOLUME // 10))
    soil = flat_soil(6.0, 0.2, soil="wet clay")
    moistures = soil.loose_soils[0].moisture, before.loose_soils[0].moisture
    soil.continue_from(before)
    assert soil.total_mm3 == before.total_mm3
    assert soil.verify_volume()
    assert soil.revision == before.revision
    assert np.array_equal(soil.columns.height, before.columns.height)
    assert (soil.columns.moisture == moistures[0]).all()
    assert moistures[0] != moistures[1]
    step = soil.step(1, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    assert step.map_updates.size == soil.grid.rows * soil.grid.cols, "of the moisture"
    for _ in range(20):
        soil.step(2, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    assert soil.columns.height.max() < before.columns.height.max(), "wet clay fails"
    assert soil.total_mm3 == before.total_mm3
    with pytest.raises(SoilError, match="not their number"):
        flat_soil(6.0, 0.2, additional_soils=("gravel",)).continue_from(before)
    with pytest.raises(SoilError, match="keep the site"):
        flat_soil(6.0, 0.2, soil_depth=9.0).continue_from(before)
