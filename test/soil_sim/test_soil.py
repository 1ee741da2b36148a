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
from soil_sim.columns.state import add_loose, remove_from_column
from soil_sim.errors import SoilError
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams


def test_landing_splits_exactly_over_the_four_nearest_points() -> None:
    soil = flat_soil(6.0, 0.2, repose_angle=80.0)
    x, y = soil.grid.x(10.25), soil.grid.y(12.5)
    step = soil.step(0, NO_SWEEPS, make_deposit_requests(x, y, 1_000_003))
    cells = {(int(r["row"]), int(r["col"])) for r in step.map_updates}
    assert cells == {(10, 12), (10, 13), (11, 12), (11, 13)}
    loose = soil.columns.loose[10:12, 12:14]
    assert loose.sum() == 1_000_003
    share = np.array([[0.375, 0.375], [0.125, 0.125]]) * 1_000_003
    assert np.abs(loose - share).max() < 60  # the point itself is a float32


def test_landed_rows_are_answered_in_order() -> None:
    soil = flat_soil(6.0, 0.2)
    rows = make_deposit_requests([0.0, 50.0, np.nan, 1.0], [0.0, 0.0, 0.0, 1.0], 500_000)
    rows["volume_mm3"][3] = 0
    answers = soil.step(0, NO_SWEEPS, rows).conversions
    assert answers["particle_id"].tolist() == [1, 2, 3, 4]
    assert answers["kind"].tolist() == [
        ConversionKind.DEPOSIT,
        ConversionKind.OUTSIDE,
        ConversionKind.REJECT,
        ConversionKind.REJECT,
    ]
    assert soil.columns.loose.sum() == 500_000


def test_a_particle_named_twice_in_a_tick_lands_once() -> None:
    soil = flat_soil(6.0, 0.2)
    rows = make_deposit_requests([0.0, 1.0, 0.0, 2.0], [0.0, 1.0, 0.0, 0.0], 500_000)
    rows["particle_id"] = [7, 8, 7, 7]
    rows["machine_id"][3] = 2  # another machine's particle
    start = soil.total_mm3
    answers = soil.step(0, NO_SWEEPS, rows).conversions
    assert answers["kind"].tolist() == [
        ConversionKind.DEPOSIT,
        ConversionKind.DEPOSIT,
        ConversionKind.REJECT,
        ConversionKind.DEPOSIT,
    ]
    assert soil.total_mm3 == start + 3 * 500_000


@pytest.mark.parametrize("z", [np.nan, np.inf, -np.inf])
def test_a_particle_at_no_finite_height_is_refused(z: float) -> None:
    soil = flat_soil(6.0, 0.2)
    rows = make_deposit_requests(0.0, 0.0, 500_000)
    rows["z"] = z
    step = soil.step(0, NO_SWEEPS, rows)
    assert step.conversions["kind"].tolist() == [ConversionKind.REJECT]
    assert step.map_updates.size == 0


def test_changed_cells_are_those_whose_volume_changed() -> None:
    soil = flat_soil(6.0, 0.2)
    before = soil.columns.firm + soil.columns.loose
    map_updates = soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, 50_000_000)).map_updates
    after = soil.columns.firm + soil.columns.loose
    said = np.zeros(soil.grid.shape, dtype=bool)
    said[map_updates["row"], map_updates["col"]] = True
    assert np.array_equal(said, before != after)
    assert np.array_equal(map_updates["volume_mm3"], after[said])
    assert map_updates["z"] == pytest.approx(soil.columns.height[said])
    assert (map_updates["revision"] == 1).all()


@pytest.mark.parametrize("mode", ["swept", "reference"])
def test_a_cut_too_thin_to_take_a_mm3_changes_nothing(mode: str) -> None:
    soil = flat_soil(6.0, 0.2, cut_mode=mode)
    soil.columns.height[:] += 2e-9  # 0.08 mm^3 of a column
    step = soil.step(0, bucket_sweep((0, 0, 0), (0, 0, 0)), NO_DEPOSIT_REQUESTS)
    assert step.conversions.size == 0
    assert step.map_updates.size == 0
    assert soil.revision == 0


def test_a_column_that_gives_what_it_got_has_not_changed() -> None:
    soil = flat_soil(6.0, 0.2)
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, 1000))
    add_loose(soil.columns.arrays, 40, 500, 500, 0, 0)
    remove_from_column(soil.columns.arrays, 40, 500.0)
    step = soil.step(1, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    assert step.map_updates.size == 0
    assert soil.revision == 1


def test_same_input_gives_same_state_hash_and_one_mm3_another() -> None:
    hashes = []
    for extra in (0, 0, 1):
        soil = flat_soil(20.0, 0.2)
        soil.step(0, bucket_sweep((0, 0, 0.1), (0.1, 0, -0.3)), NO_DEPOSIT_REQUESTS)
        soil.step(1, NO_SWEEPS, make_deposit_requests(2.0, 3.0, 700_000 + extra))
        hashes.append(soil.state_hash())
    assert hashes[0] == hashes[1]
    assert hashes[0] != hashes[2]


def test_state_hash_follows_every_change() -> None:
    soil = flat_soil(20.0, 0.2)
    first = soil.state_hash()
    soil.step(0, NO_SWEEPS, make_deposit_requests(8.0, 8.0, 1))
    assert soil.state_hash() != first


def test_volume_beyond_a_row_is_split() -> None:
    grid = Grid(8, 8, 4.0)
    soil = Soil(grid, np.zeros(grid.shape))
    start = soil.total_mm3
    rows = soil.step(
        0, bucket_sweep((2, 0, 0.1), (2, 0, -15.0), width=12.0), NO_DEPOSIT_REQUESTS
    ).conversions
    assert (rows["volume_mm3"] == MAX_ROW_VOLUME).any()
    assert start - soil.total_mm3 == int(rows["volume_mm3"].astype(np.int64).sum())


def test_heights_that_are_not_finite_are_refused() -> None:
    heights = np.zeros((8, 8))
    heights[3, 4] = np.nan
    with pytest.raises(SoilError, match="finite"):
        Soil(Grid(8, 8, 1.0), heights)


def test_a_spacing_below_a_centimetre_is_refused() -> None:
    assert Grid(8, 8, 0.01).cell == 0.01
    with pytest.raises(ParameterError, match=r"0\.01 m"):
        Grid(8, 8, 0.009)


def test_a_map_whose_volume_would_overflow_is_refused() -> None:
    grid = Grid(40, 40, 60.0)
    with pytest.raises(SoilError, match="smaller soil_depth, cell or map"):
        Soil(grid, np.zeros(grid.shape), SoilParams(soil_depth=1000.0))


def test_the_largest_map_keeps_its_account() -> None:
    grid = Grid(35, 35, 60.0)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil_depth=1000.0))
    soil.step(0, NO_SWEEPS, make_deposit_requests(0.0, 0.0, MAX_ROW_VOLUME))
    assert soil.total_mm3 == 35**2 * 60_000**2 * 1_000_000 + MAX_ROW_VOLUME
    assert soil.verify_volume()
