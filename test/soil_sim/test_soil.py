import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.soil_scenes import NO_LANDED, NO_SWEEPS, bucket_sweep, flat_soil, landings

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import MAX_ROW_VOLUME, Kind
from soil_sim.errors import SoilError
from soil_sim.soil import Soil


def test_landing_splits_exactly_over_the_four_nearest_points() -> None:
    soil = flat_soil(6.0, 0.2, repose_angle=80.0)
    x, y = soil.grid.x(10.25), soil.grid.y(12.5)
    step = soil.step(0, NO_SWEEPS, landings(x, y, 1_000_003))
    cells = {(int(r["row"]), int(r["col"])) for r in step.changed}
    assert cells == {(10, 12), (10, 13), (11, 12), (11, 13)}
    loose = soil.columns.loose[10:12, 12:14]
    assert loose.sum() == 1_000_003
    share = np.array([[0.375, 0.375], [0.125, 0.125]]) * 1_000_003
    assert np.abs(loose - share).max() < 60  # the point itself is a float32


def test_landed_rows_are_answered_in_order() -> None:
    soil = flat_soil(6.0, 0.2)
    rows = landings([0.0, 50.0, np.nan, 1.0], [0.0, 0.0, 0.0, 1.0], 500_000)
    rows["volume_mm3"][3] = 0
    answers = soil.step(0, NO_SWEEPS, rows).conversions
    assert answers["particle_id"].tolist() == [1, 2, 3, 4]
    assert answers["kind"].tolist() == [Kind.DEPOSIT, Kind.OUTSIDE, Kind.REFUSE, Kind.REFUSE]
    assert soil.columns.loose.sum() == 500_000


def test_changed_cells_are_those_whose_volume_changed() -> None:
    soil = flat_soil(6.0, 0.2)
    before = soil.columns.volume(*np.indices(soil.grid.shape))
    changed = soil.step(0, NO_SWEEPS, landings(0.0, 0.0, 50_000_000)).changed
    after = soil.columns.volume(*np.indices(soil.grid.shape))
    said = np.zeros(soil.grid.shape, dtype=bool)
    said[changed["row"], changed["col"]] = True
    assert np.array_equal(said, before != after)
    assert np.array_equal(changed["volume_mm3"], after[said])
    assert changed["z"] == pytest.approx(soil.columns.height[said])
    assert (changed["revision"] == 1).all()


def test_same_input_gives_same_state_hash_and_one_mm3_another() -> None:
    hashes = []
    for extra in (0, 0, 1):
        soil = flat_soil(20.0, 0.2)
        soil.step(0, bucket_sweep((0, 0, 0.1), (0.1, 0, -0.3)), NO_LANDED)
        soil.step(1, NO_SWEEPS, landings(2.0, 3.0, 700_000 + extra))
        hashes.append(soil.state_hash())
    assert hashes[0] == hashes[1]
    assert hashes[0] != hashes[2]


def test_state_hash_follows_every_change() -> None:
    soil = flat_soil(20.0, 0.2)
    first = soil.state_hash()
    soil.step(0, NO_SWEEPS, landings(8.0, 8.0, 1))
    assert soil.state_hash() != first


def test_volume_beyond_a_row_is_split() -> None:
    grid = Grid(8, 8, 4.0)
    soil = Soil(grid, np.zeros(grid.shape))
    start = soil.total_mm3
    rows = soil.step(0, bucket_sweep((2, 0, 0.1), (2, 0, -15.0), width=12.0), NO_LANDED).conversions
    assert (rows["volume_mm3"] == MAX_ROW_VOLUME).any()
    assert start - soil.total_mm3 == int(rows["volume_mm3"].astype(np.int64).sum())


def test_heights_that_are_not_finite_are_refused() -> None:
    heights = np.zeros((8, 8))
    heights[3, 4] = np.nan
    with pytest.raises(SoilError, match="finite"):
        Soil(Grid(8, 8, 1.0), heights)


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    cell=st.sampled_from([0.1, 0.25, 0.5]),
    angle=st.floats(10.0, 60.0),
    swell=st.sampled_from([0.0, 0.1, 0.6]),
    mode=st.sampled_from(["swept", "reference"]),
)
def test_no_random_work_loses_soil_or_leaves_it_too_steep(
    seed: int, cell: float, angle: float, swell: float, mode: str
) -> None:
    rng = np.random.default_rng(seed)
    soil = flat_soil(5.0, cell, repose_angle=angle, swell=swell, cut_mode=mode)
    balance = soil.total_mm3
    for tick in range(25):
        a, b = rng.uniform(-2.8, 2.8, (2, 3)) * (1, 1, 0.3)
        sweep = bucket_sweep(tuple(a), tuple(b)) if rng.random() < 0.5 else NO_SWEEPS
        points = rng.uniform(-2.9, 2.9, (2, 20))
        landed = landings(*points, int(rng.integers(1, 30_000_000)))
        rows = soil.step(tick, sweep, landed).conversions
        volume = rows["volume_mm3"].astype(np.int64)
        balance += int(volume[rows["kind"] == Kind.DEPOSIT].sum())
        balance -= int(volume[rows["kind"] == Kind.EXCAVATE].sum())
        assert soil.columns.total_mm3 == soil.total_mm3 == balance
    soil.step(26, bucket_sweep((0, 0, 9), (0, 0, 9)), NO_LANDED)
    soil.slip.relax()
    assert soil.slip.steepest_excess() <= soil.params.slip_tolerance + 1e-9
    assert soil.columns.firm.min() >= 0
    assert soil.columns.loose.min() >= 0
