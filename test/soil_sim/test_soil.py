import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.soil_scenes import NO_LANDED, NO_SWEEPS, bucket_sweep, flat_soil, landings

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import MAX_ROW_VOLUME, Kind, Rows
from soil_sim.columns import add_loose, take_from_column
from soil_sim.errors import SoilError
from soil_sim.params import SoilParams
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


def test_a_particle_named_twice_in_a_tick_lands_once() -> None:
    soil = flat_soil(6.0, 0.2)
    rows = landings([0.0, 1.0, 0.0, 2.0], [0.0, 1.0, 0.0, 0.0], 500_000)
    rows["particle_id"] = [7, 8, 7, 7]
    rows["source"][3] = 2  # another machine's particle
    start = soil.total_mm3
    answers = soil.step(0, NO_SWEEPS, rows).conversions
    assert answers["kind"].tolist() == [Kind.DEPOSIT, Kind.DEPOSIT, Kind.REFUSE, Kind.DEPOSIT]
    assert soil.total_mm3 == start + 3 * 500_000


@pytest.mark.parametrize("z", [np.nan, np.inf, -np.inf])
def test_a_particle_at_no_finite_height_is_refused(z: float) -> None:
    soil = flat_soil(6.0, 0.2)
    rows = landings(0.0, 0.0, 500_000)
    rows["z"] = z
    step = soil.step(0, NO_SWEEPS, rows)
    assert step.conversions["kind"].tolist() == [Kind.REFUSE]
    assert step.changed.size == 0


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


@pytest.mark.parametrize("mode", ["swept", "reference"])
def test_a_cut_too_thin_to_take_a_mm3_changes_nothing(mode: str) -> None:
    soil = flat_soil(6.0, 0.2, cut_mode=mode)
    soil.columns.height[:] += 2e-9  # 0.08 mm^3 of a column
    step = soil.step(0, bucket_sweep((0, 0, 0), (0, 0, 0)), NO_LANDED)
    assert step.conversions.size == 0
    assert step.changed.size == 0
    assert soil.revision == 0


def test_a_column_that_gives_what_it_got_has_not_changed() -> None:
    soil = flat_soil(6.0, 0.2)
    soil.step(0, NO_SWEEPS, landings(0.0, 0.0, 1000))
    add_loose(soil.columns.arrays, 40, 500, 500, 0, 0)
    take_from_column(soil.columns.arrays, 40, 500.0)
    step = soil.step(1, NO_SWEEPS, NO_LANDED)
    assert step.changed.size == 0
    assert soil.revision == 1


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


def test_a_spacing_below_a_centimetre_is_refused() -> None:
    assert Grid(8, 8, 0.01).cell == 0.01
    with pytest.raises(ParameterError, match=r"0\.01 m"):
        Grid(8, 8, 0.009)


def test_a_map_whose_volume_would_overflow_is_refused() -> None:
    grid = Grid(40, 40, 60.0)
    with pytest.raises(SoilError, match="smaller dig_depth, cell or map"):
        Soil(grid, np.zeros(grid.shape), SoilParams(dig_depth=1000.0))


def test_the_largest_map_keeps_its_account() -> None:
    grid = Grid(35, 35, 60.0)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(dig_depth=1000.0))
    soil.step(0, NO_SWEEPS, landings(0.0, 0.0, MAX_ROW_VOLUME))
    assert soil.total_mm3 == 35**2 * 60_000**2 * 1_000_000 + MAX_ROW_VOLUME
    assert soil.verify()


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
        if rng.random() < 0.5:
            sweep, landed = spoilt(sweep, rng), spoilt(landed, rng)
        step = soil.step(tick, sweep, landed)
        volume = step.conversions["volume_mm3"].astype(np.int64)
        kind = step.conversions["kind"]
        balance += int(volume[kind == Kind.DEPOSIT].sum())
        balance -= int(volume[kind == Kind.EXCAVATE].sum())
        assert soil.columns.total_mm3 == soil.total_mm3 == balance
        assert (kind != Kind.EXCAVATE).sum() == landed.size
        tools = np.unique(sweep[["source", "tool"]]).size
        assert step.forces.size + len(step.refused) == tools
        assert np.isfinite(soil.columns.height).all()
    soil.step(26, bucket_sweep((0, 0, 9), (0, 0, 9)), NO_LANDED)
    soil.slip.relax()
    assert soil.slip.steepest_excess() <= soil.params.slip_tolerance + 1e-9
    assert soil.columns.firm.min() >= 0
    assert soil.columns.loose.min() >= 0


def spoilt(rows: Rows, rng: np.random.Generator) -> Rows:
    """Rows as a broken machine may send them: fields of any bits, rows lost, doubled or mixed."""
    rows = rows.copy()
    for _ in range(rng.integers(1, 5)):
        if rows.size == 0:
            break
        row, name = rng.integers(rows.size), str(rng.choice(rows.dtype.names))
        what = rng.integers(4)
        if what == 0:
            field = rows[name][row : row + 1].view(np.uint8)
            field[:] = rng.integers(0, 256, field.size)
        elif what == 1 and name in ("x", "y", "z", "x0", "y0", "z0", "x1", "y1", "z1"):
            rows[name][row] = rng.choice([np.nan, np.inf, -np.inf, 1e18, -1e18, 3e38, 1e5, -30.0])
        elif what == 2:
            rows = np.delete(rows, row)
        else:
            rows = rows[rng.integers(0, rows.size, rows.size)]
    return rows
