"""A plate compacts loose soil, packs firm soil under pressure, and removes none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    excavated_mm3,
    make_deposit_requests,
    tool_sweep,
)

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import Rows, SweepAction
from soil_sim.columns.operations import add_loose, remove_firm
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

GRID = Grid(61, 61, 0.1)
SHOE = ((0.4, 0.0), (-0.4, 0.0))  # (x, z) of the front and rear edge of a track shoe [m]
WIDTH = 0.5
SWELL = 0.4


def loose_ground(depth: float, **params: object) -> Soil:
    """Return level ground with loose soil of a depth [m] on it."""
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(swell=SWELL, **params))  # type: ignore[arg-type]
    volume = round(depth / (1.0 + SWELL) / soil.columns.metres_per_mm3)
    x, y = np.meshgrid(soil.grid.x(np.arange(61)), soil.grid.y(np.arange(61)), indexing="ij")
    soil.step(0, NO_SWEEPS, make_deposit_requests(x.reshape(-1), y.reshape(-1), volume))
    return soil


def shoe(
    start: tuple[float, float, float], end: tuple[float, float, float], pressure: float = 0.0
) -> Rows:
    """Return the sweep of a track shoe from start to end (x, y, z) [m] under a pressure [Pa]."""
    rows = tool_sweep(SHOE, start, end, width=WIDTH)
    rows["action"], rows["pressure"] = SweepAction.COMPACT, pressure
    return rows


def press(soil: Soil, pressure: float, depth: float = 0.5) -> float:
    """Press a shoe down to a depth at most [m], and return the depth of its rut [m]."""
    rows = shoe((0, 0, 0.1), (0, 0, -depth), pressure)
    assert not soil.step(1, rows, NO_DEPOSIT_REQUESTS).rejected_tools
    return -float(soil.columns.height[30, 30])


def bekker_depth(soil: Soil, pressure: float) -> float:
    """Return the sinkage of the shoe by Bekker's equation [m]."""
    kind = soil.soil_types[0].loose_soil
    modulus = kind.bekker_k_c / WIDTH + kind.bekker_k_phi
    modulus *= kind.moisture_bearing_factor(int(soil.columns.moisture[30, 30]))
    return float((pressure / modulus) ** (1.0 / kind.bekker_n))


def test_plate_compacts_the_loose_soil_under_it_and_keeps_its_volume() -> None:
    soil = loose_ground(0.2)
    before = soil.total_mm3
    step = soil.step(1, shoe((0, 0, 0.3), (0, 0, 0.17)), NO_DEPOSIT_REQUESTS)
    assert step.conversions.size == 0
    assert soil.total_mm3 == before
    assert soil.verify_volume()
    under = soil.columns.height[27:34, 29:32]
    np.testing.assert_allclose(under, 0.17, atol=1e-6)
    assert soil.columns.height[30, 40] == pytest.approx(0.2, abs=1e-6)


def test_bulk_volume_is_not_compacted_below_the_bank_volume() -> None:
    soil = loose_ground(0.2)
    soil.relaxation.is_enabled = False
    soil.step(1, shoe((0, 0, 0.3), (0, 0, -0.5)), NO_DEPOSIT_REQUESTS)
    assert soil.columns.height[30, 30] == pytest.approx(0.2 / (1.0 + SWELL), abs=1e-6)
    assert (soil.columns.bulk >= soil.columns.loose).all()


def test_firm_soil_does_not_yield_without_pressure() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="loam"))
    step = soil.step(0, shoe((0, 0, 0.1), (0, 0, -0.3)), NO_DEPOSIT_REQUESTS)
    assert step.map_updates.size == 0


def test_rigid_soil_does_not_yield() -> None:
    assert press(Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="gravel")), 1e6) == 0.0


@pytest.mark.parametrize(
    ("kind", "moisture", "pressure"),
    [("loam", 0, 60e3), ("loam", 100, 40e3), ("dry sand", 0, 80e3), ("topsoil", 50, 50e3)],
)
def test_firm_soil_yields_to_a_pressure_as_far_as_bekker(
    kind: str, moisture: int, pressure: float
) -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil=kind, moisture=moisture))
    soil.relaxation.is_enabled = False
    before = soil.total_mm3
    depth = press(soil, pressure)
    assert depth == pytest.approx(bekker_depth(soil, pressure), abs=1e-6)
    assert press(soil, pressure) == depth, "no deeper the second time"
    assert press(soil, 0.5 * pressure) == depth
    deeper = press(soil, 1.5 * pressure)
    assert deeper == pytest.approx(bekker_depth(soil, 1.5 * pressure), abs=1e-6)
    assert soil.columns.rut_depth[30, 30] == pytest.approx(deeper, abs=1e-6)
    assert soil.total_mm3 == before
    assert soil.verify_volume()


def test_firm_soil_is_not_pressed_below_the_plate_nor_packed_more_than_it_shrinks() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="loam", moisture=100))
    assert press(soil, 1e7, depth=0.1) == pytest.approx(0.1, abs=1e-6)
    shallow = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="loam", soil_depth=0.5))
    shallow.relaxation.is_enabled = False
    shrinkage = shallow.soil_types[0].shrinkage
    assert press(shallow, 1e7) == pytest.approx(0.5 * shrinkage, abs=1e-6)


def test_soil_that_is_cut_from_a_rut_is_denser() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="loam", moisture=100))
    soil.relaxation.is_enabled = False
    rut = press(soil, 40e3)
    shrinkage = soil.soil_types[0].shrinkage
    packed = rut * (1.0 - shrinkage) / shrinkage
    cell = 1.0 / soil.columns.metres_per_mm3
    before = int(soil.columns.firm[30, 30])
    half = remove_firm(soil.columns.arrays, 30 * 61 + 30, 0.5 * packed * cell)
    assert half == pytest.approx(0.5 * packed * cell / (1.0 - shrinkage), abs=2)
    assert soil.columns.height[30, 30] == pytest.approx(-rut - 0.5 * packed, abs=1e-6)
    rest = remove_firm(soil.columns.arrays, 30 * 61 + 30, (0.5 * packed + 0.1) * cell)
    assert rest == pytest.approx((0.5 * packed / (1.0 - shrinkage) + 0.1) * cell, abs=3)
    assert soil.columns.packing[30, 30] == 0
    assert soil.columns.firm[30, 30] == before - half - rest
    assert soil.columns.rut_depth[30, 30] == 0.0


def test_packed_soil_of_a_kind_that_does_not_shrink_any_more_regains_its_volume() -> None:
    """As after a run was continued with other parameters."""
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="loam", moisture=100))
    soil.relaxation.is_enabled = False
    press(soil, 40e3)
    soil.columns.tables.shrinkage[:] = 0.0
    volume = round(0.1 / soil.columns.metres_per_mm3)
    packing = int(soil.columns.packing[30, 30])
    assert remove_firm(soil.columns.arrays, 30 * 61 + 30, volume) == volume + packing
    assert soil.columns.packing[30, 30] == 0


def test_soil_that_falls_into_a_rut_makes_it_less_deep() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="loam", moisture=100))
    soil.relaxation.is_enabled = False
    rut = press(soil, 40e3)
    volume = round(0.02 / soil.columns.metres_per_mm3)
    add_loose(soil.columns.arrays, 30 * 61 + 30, volume, volume, 0, 100)
    assert soil.columns.rut_depth[30, 30] == pytest.approx(rut - 0.02, abs=1e-6)
    assert press(soil, 40e3) == pytest.approx(rut, abs=1e-6), "it yields to the same depth again"


def test_moving_plate_leaves_a_rut_of_its_width() -> None:
    soil = loose_ground(0.2)
    soil.step(1, shoe((-1.0, 0, 0.3), (-1.0, 0, 0.18)), NO_DEPOSIT_REQUESTS)
    for tick in range(20):
        x = -1.0 + 0.1 * tick
        soil.step(2 + tick, shoe((x, 0, 0.18), (x + 0.1, 0, 0.18)), NO_DEPOSIT_REQUESTS)
    across = soil.columns.height[30]
    assert (across < 0.185).sum() == 5
    along = soil.columns.height[:, 30]
    assert (along < 0.185).sum() == pytest.approx(28, abs=1)


def test_fast_plate_leaves_no_gap() -> None:
    soil = loose_ground(0.2)
    soil.step(1, shoe((-2.0, 0, 0.18), (2.0, 0, 0.18)), NO_DEPOSIT_REQUESTS)
    assert (soil.columns.height[15:46, 30] < 0.185).all()


def test_inclined_plate_leaves_an_inclined_surface() -> None:
    soil = loose_ground(0.2)
    rows = tool_sweep(((0.4, 0.03), (-0.4, -0.03)), (0, 0, 0.3), (0, 0, 0.17), width=0.5)
    rows["action"] = SweepAction.COMPACT
    soil.step(1, rows, NO_DEPOSIT_REQUESTS)
    x = soil.grid.x(np.arange(27, 34))
    np.testing.assert_allclose(soil.columns.height[27:34, 30], 0.17 + 0.03 * x / 0.4, atol=1e-6)


def test_compacted_soil_can_be_dug() -> None:
    soil = loose_ground(0.3, repose_angle=30.0)
    soil.relaxation.is_enabled = False
    soil.step(1, shoe((0, 0, 0.4), (0, 0, 0.0)), NO_DEPOSIT_REQUESTS)
    packed = soil.columns.bulk[30, 30] / soil.columns.loose[30, 30]
    assert packed == pytest.approx(1.0)
    soil.relaxation.is_enabled = True
    rows = tool_sweep(((0.0, 0.0), (-0.2, 0.2)), (0.1, 0, 0.3), (0.1, 0, 0.05), width=0.6)
    assert excavated_mm3(soil.step(2, rows, NO_DEPOSIT_REQUESTS)) > 0
    assert soil.verify_volume()


def test_plate_across_the_edge_of_the_map_compacts_what_is_on_it() -> None:
    soil = loose_ground(0.2)
    edge = soil.grid.x(0)
    soil.step(1, shoe((edge, 0, 0.3), (edge, 0, 0.17)), NO_DEPOSIT_REQUESTS)
    assert soil.columns.height[0, 30] == pytest.approx(0.17, abs=1e-6)
    assert math.isclose(soil.columns.height[10, 30], 0.2, abs_tol=1e-6)
