"""Moisture of soil that is excavated, deposited, mixed and held by machines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    bucket_sweep,
    flat_soil,
    make_deposit_requests,
    scoop,
)

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import CONVERSION, ConversionKind, Rows, empty_rows
from soil_sim.columns import Columns
from soil_sim.columns.operations import add_loose, mix_moisture, remove_loose
from soil_sim.soil import Soil
from soil_sim.soil_inventory import SoilInventory
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import SoilType, build_soil_tables

GRID = Grid(41, 41, 0.2)
BOTH = pytest.mark.parametrize("mode", ["swept", "reference"])
MIXING = st.lists(st.tuples(st.integers(1, 10**7), st.integers(0, 100)), min_size=1, max_size=60)
"""Volumes [mm^3] and moistures [%]."""


def water_of(columns: Columns) -> int:
    """Return volume times moisture of all columns [mm^3 %]."""
    firm = int((columns.firm * columns.moisture.astype(np.int64)).sum())
    return firm + int((columns.loose * columns.loose_moisture.astype(np.int64)).sum())


def water_in(rows: Rows) -> int:
    """Return volume times moisture of rows [mm^3 %]."""
    return int((rows["volume_mm3"].astype(np.int64) * rows["moisture"]).sum())


def wet_and_dry(mode: str = "swept") -> Soil:
    """Return level ground, the half with y > 0 at 80 % and the other half at 10 %."""
    moisture = np.full(GRID.shape, 10, dtype=np.uint8)
    moisture[:, :20] = 80
    params = SoilParams(cut_mode=mode, soil="loam")
    return Soil(GRID, np.zeros(GRID.shape), params, moisture=moisture)


def dry_columns() -> Columns:
    return Columns(
        GRID, np.zeros(GRID.shape), soil_depth=1.0, tables=build_soil_tables([SoilType()])
    )


# Excavation


@BOTH
def test_excavated_firm_soil_has_the_moisture_of_its_column(mode: str) -> None:
    soil = wet_and_dry(mode)
    rows = soil.step(
        0, bucket_sweep((0.5, 0, 0.1), (0.5, 0, -0.2)), NO_DEPOSIT_REQUESTS
    ).conversions
    assert set(rows["moisture"].tolist()) == {10, 80}
    assert np.array_equal(rows["moisture"], soil.columns.moisture[rows["row"], rows["col"]])


@BOTH
def test_excavated_loose_and_firm_soil_have_their_mean_moisture(mode: str) -> None:
    soil = wet_and_dry(mode)
    soil.relaxation.is_enabled = False
    columns = soil.columns
    for i in range(columns.firm.size):
        add_loose(columns.arrays, i, 4_000_000, 5_000_000, 0, 30)
    firm_before = columns.firm.copy()
    rows = soil.step(
        0, bucket_sweep((0.5, 0, 0.2), (0.5, 0, -0.2)), NO_DEPOSIT_REQUESTS
    ).conversions
    cells = (rows["row"], rows["col"])
    total = np.bincount(
        np.ravel_multi_index(cells, GRID.shape), rows["volume_mm3"], firm_before.size
    )
    firm = (firm_before - columns.firm)[cells]
    is_mixed = (firm > 0) & (total[np.ravel_multi_index(cells, GRID.shape)] == rows["volume_mm3"])
    mean = (4e6 * 30 + firm * columns.moisture[cells].astype(float)) / (4e6 + firm)
    assert is_mixed.sum() > 5
    assert np.abs(rows["moisture"] - mean)[is_mixed].max() <= 1.0
    assert set(rows["moisture"][firm == 0].tolist()) <= {30}


@BOTH
def test_water_removed_from_the_columns_is_in_the_rows(mode: str) -> None:
    soil = wet_and_dry(mode)
    before = water_of(soil.columns)
    removed = 0
    for tick in range(60):
        x = 0.02 * tick
        sweep = bucket_sweep((x, 0, -0.3), (x + 0.02, 0, -0.3))
        removed += water_in(soil.step(tick, sweep, NO_DEPOSIT_REQUESTS).conversions)
    # The moisture of each row is rounded by less than one per cent, without bias.
    assert before - water_of(soil.columns) == pytest.approx(removed, rel=5e-3)


# Deposition


def test_conversions_of_deposit_requests_repeat_soil_and_moisture() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="loam", additional_soils=("gravel",)))
    rows = make_deposit_requests([0.0, 50.0, 0.5, 1.0], 0.0, 500_000)
    rows["moisture"], rows["soil"] = (60, 70, 101, 90), (0, 1, 0, 1)
    conversions = soil.step(0, NO_SWEEPS, rows).conversions
    kinds = [
        ConversionKind.DEPOSIT,
        ConversionKind.OUTSIDE,
        ConversionKind.REJECT,
        ConversionKind.DEPOSIT,
    ]
    assert conversions["kind"].tolist() == kinds
    assert conversions["moisture"].tolist() == [60, 70, 101, 90]
    assert conversions["soil"].tolist() == [0, 1, 0, 1]


def test_deposited_soil_keeps_its_water() -> None:
    soil = flat_soil(6.0, 0.1, repose_angle=35.0, swell=0.15)
    before, deposited = water_of(soil.columns), 0
    for tick in range(200):
        rows = make_deposit_requests(0.05 * (tick % 3), 0.03 * (tick % 5), 1_000_000)
        rows["moisture"] = 20 if tick % 2 else 90
        deposited += water_in(rows)
        soil.step(tick, NO_SWEEPS, rows)
    assert water_of(soil.columns) - before == pytest.approx(deposited, rel=0.02)


# Mixing


@given(MIXING)
def test_moisture_of_a_mixture_is_within_one_per_cent_of_the_mean(
    parts: list[tuple[int, int]],
) -> None:
    bank, moisture = parts[0]
    for volume, other in parts[1:]:
        mean = (bank * moisture + volume * other) / (bank + volume)
        mixed = int(mix_moisture(bank, np.uint8(moisture), volume, np.uint8(other)))
        assert abs(mixed - mean) < 1.0
        assert min(moisture, other) <= mixed <= max(moisture, other)
        bank, moisture = bank + volume, mixed


@given(st.integers(1, 2**50), st.integers(1, 2**50), st.integers(0, 100))
def test_mixture_of_equal_moistures_keeps_it(bank: int, other: int, moisture: int) -> None:
    wet = np.uint8(moisture)
    assert mix_moisture(bank, wet, other, wet) == moisture
    assert mix_moisture(0, np.uint8(1), other, wet) == moisture
    assert mix_moisture(bank, wet, 0, np.uint8(1)) == moisture


@pytest.mark.parametrize(("below", "above"), [(0, 100), (40, 60), (60, 40), (40, 41)])
def test_many_thin_layers_wet_deep_soil(below: int, above: int) -> None:
    # A layer of a thousandth changes the mean by less than half a per cent, which rounding to the
    # nearest would lose.
    columns, count = dry_columns(), 400
    for i in range(count):
        deep = 8_000_000 + 1000 * i
        add_loose(columns.arrays, i, deep, deep, 0, below)
        for _ in range(1000):
            add_loose(columns.arrays, i, 8_000, 8_000, 0, above)
    moistures = columns.loose_moisture.reshape(-1)[:count].astype(float)
    assert moistures.mean() == pytest.approx((below + above) / 2, abs=0.5)


@settings(deadline=None, max_examples=20)
@given(MIXING)
def test_removing_soil_does_not_change_the_moisture_of_the_rest(
    parts: list[tuple[int, int]],
) -> None:
    columns = dry_columns()
    for volume, moisture in parts:
        add_loose(columns.arrays, 3, volume, volume, 0, moisture)
    wet = columns.loose_moisture.flat[3]
    while columns.loose.flat[3]:
        remove_loose(columns.arrays, 3, 1 + columns.loose.flat[3] // 2)
        assert columns.loose_moisture.flat[3] == wet


def test_state_hash_depends_on_moisture() -> None:
    hashes = []
    for extra in (0, 0, 1):
        soil = wet_and_dry()
        scoop(soil, depth=0.3, length=1.5)
        rows = make_deposit_requests([0.0, 0.5], [0.0, 0.2], 5_000_000)
        rows["moisture"] = 40 + extra
        soil.step(900, NO_SWEEPS, rows)
        for tick in range(901, 930):
            soil.step(tick, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        hashes.append(soil.state_hash())
    assert hashes[0] == hashes[1]
    assert hashes[0] != hashes[2]


# Soil held by machines


def conversion_rows(*rows: tuple[ConversionKind, int, int, int], machine_id: int = 1) -> Rows:
    """Return CONVERSION rows from (kind, volume, soil, moisture)."""
    out = empty_rows(CONVERSION, len(rows))
    out["machine_id"] = machine_id
    for name, values in zip(
        ("kind", "volume_mm3", "soil", "moisture"), zip(*rows, strict=True), strict=True
    ):
        out[name] = values
    return out


ACCOUNTS = {1: 5, 2: 6}
"""Numbers of accounts by machine id."""


def test_inventory_returns_the_majority_soil_a_machine_holds() -> None:
    inventory = SoilInventory()
    assert inventory.majority_soil(5) == (0, 0)
    inventory.record_conversions(
        conversion_rows(
            (ConversionKind.EXCAVATE, 4000, 2, 90), (ConversionKind.EXCAVATE, 1000, 1, 10)
        ),
        ACCOUNTS,
    )
    inventory.record_conversions(
        conversion_rows((ConversionKind.EXCAVATE, 7, 3, 77), machine_id=2), ACCOUNTS
    )
    assert inventory.majority_soil(5) == (2, 74)
    inventory.record_conversions(
        conversion_rows(
            (ConversionKind.REJECT, 4000, 2, 90), (ConversionKind.OUTSIDE, 2000, 2, 90)
        ),
        ACCOUNTS,
    )
    assert inventory.majority_soil(5) == (2, 63)
    inventory.record_conversions(conversion_rows((ConversionKind.DEPOSIT, 2000, 2, 90)), ACCOUNTS)
    assert inventory.majority_soil(5) == (1, 10)
    inventory.record_conversions(conversion_rows((ConversionKind.DEPOSIT, 1000, 1, 10)), ACCOUNTS)
    assert inventory.majority_soil(5) == (0, 0)
    assert inventory.majority_soil(6) == (3, 77)
    inventory.record_conversions(conversion_rows((ConversionKind.DEPOSIT, 7, 3, 77)), {})
    inventory.merge(6, 8)
    assert inventory.majority_soil(6) == (0, 0)
    inventory.merge(8, 6)
    inventory.retain({6})
    assert inventory.majority_soil(6) == (3, 77)
    inventory.remove(6)
    assert inventory.majority_soil(6) == (0, 0)
