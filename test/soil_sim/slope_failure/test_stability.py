"""Faces of firm soil stand to the critical height of Culmann's method on any grid."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from support.soil_scenes import NO_DEPOSIT_REQUESTS, NO_SWEEPS, come_to_rest, tool_sweep

from msg_bridge.contract.grid import Grid
from soil_sim.slope_failure.stability import critical_height
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import SoilType, load_soil_types

SLOPE = 60.0
WIDTH = 1.0  # width of the map along the face [m]


@pytest.fixture
def params(tmp_path: Path) -> SoilParams:
    soils = tmp_path / "soils.yaml"
    soils.write_text(
        "weak: {cohesion: 2000.0, density: 1500.0, internal_friction: 25.0, repose_angle: 30.0}"
    )
    return SoilParams(soil="weak", soils=str(soils))


def soil_type_of(params: SoilParams) -> SoilType:
    return load_soil_types(params.soils)[params.soil]


def face_height(params: SoilParams) -> float:
    """Return the critical height of a face at `SLOPE` [m]."""
    kind = soil_type_of(params)
    friction = math.radians(kind.internal_friction)
    return float(critical_height(kind.critical_height(0), 0.0, friction, math.radians(SLOPE)))


def plateau(params: SoilParams, height: float, cell: float, slope: float = SLOPE) -> Soil:
    """Return a plateau toward +x above ground at 0, with a face of a slope [deg] between them."""
    distance = height / math.tan(math.radians(slope))
    grid = Grid(int((distance + 4.0) / cell) + 1, int(WIDTH / cell) + 1, cell)
    x = grid.x(np.arange(grid.rows))
    profile = np.clip((x + 0.5 * distance) / max(distance, 1e-9), 0.0, 1.0) * height
    return Soil(grid, np.repeat(profile[:, None], grid.cols, axis=1), params)


def settled(soil: Soil) -> Soil:
    """Return the soil at rest, with the same volume."""
    before = soil.columns.total_mm3
    come_to_rest(soil)
    assert soil.columns.total_mm3 == before
    assert soil.relaxation.max_slope_excess() <= 2 * soil.params.relaxation_tolerance
    return soil


def fails(soil: Soil) -> bool:
    """Return whether any firm soil fails."""
    soil.relaxation.mark_all_disturbed()
    return bool(settled(soil).columns.loose.any())


def test_vertical_face_has_the_given_critical_height() -> None:
    assert critical_height(2.0, 0.0, 0.4) == pytest.approx(2.0)


def test_critical_height_without_friction_is_4_c_over_gamma_cot_of_half_the_slope() -> None:
    for slope in np.radians([30.0, 45.0, 60.0, 80.0]):
        found = critical_height(1.0, 0.0, 0.0, slope)
        assert found == pytest.approx(1.0 / math.tan(slope / 2))


def test_face_no_steeper_than_the_friction_angle_is_stable_at_any_height() -> None:
    assert critical_height(1.0, 0.0, 0.5, 0.5) == math.inf


def test_critical_height_without_cohesion_is_zero() -> None:
    assert critical_height(0.0, 1.0, 0.5) == 0.0


# c = 20 kPa, phi = 15 deg, gamma = 16 kN/m3, at 60 deg
VERTICAL = 4 * 20.0 / 16.0 * math.tan(math.radians(45.0 + 7.5))
AT_60 = 14.28


def test_critical_height_is_that_of_culmann() -> None:
    found = critical_height(VERTICAL, 0.0, math.radians(15.0), math.radians(60.0))
    assert found == pytest.approx(AT_60, abs=0.01)


def test_critical_height_over_a_distance_is_that_of_the_face_between() -> None:
    distance = AT_60 / math.tan(math.radians(60.0))
    assert critical_height(VERTICAL, distance, math.radians(15.0)) == pytest.approx(AT_60, abs=0.01)


@pytest.mark.parametrize("cell", [0.2, 0.1, 0.05])
def test_slope_fails_at_its_critical_height_on_any_grid(params, cell: float) -> None:
    high = face_height(params)
    assert high > 2.0, "many times the neighbourhood at small cells"
    assert not fails(plateau(params, 0.75 * high, cell))
    assert fails(plateau(params, 1.15 * high, cell))


@pytest.mark.parametrize("cell", [0.4, 0.1, 0.05])
def test_vertical_wall_fails_at_its_critical_height_on_any_grid(params, cell: float) -> None:
    high = soil_type_of(params).critical_height(0)
    assert not fails(plateau(params, 0.98 * high, cell, 90.0))
    assert fails(plateau(params, 1.02 * high, cell, 90.0))


def test_face_dug_at_its_toe_fails_at_its_top(params) -> None:
    high = 0.95 * face_height(params)
    soil = plateau(params, high, 0.05)
    assert not fails(soil)
    before = soil.columns.firm.copy()
    toe, depth = -0.5 * high / math.tan(math.radians(SLOPE)), 0.4
    box = ((0.0, 0.0), (-0.3, 0.0), (-0.3, 1.0), (0.0, 1.0))
    for tick in range(20):
        x = toe - 0.4 + 0.02 * tick
        sweep = tool_sweep(box, (x, 0.0, -depth), (x + 0.02, 0.0, -depth), WIDTH + 0.2)
        soil.step(tick, sweep, NO_DEPOSIT_REQUESTS)
    soil.step(20, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    settled(soil)
    top = soil.grid.x(np.arange(soil.grid.rows)) > -toe - 0.2
    assert (soil.columns.firm[top] < before[top]).any()
