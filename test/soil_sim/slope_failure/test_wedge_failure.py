"""Faces above their critical height fail along Culmann's plane, toe to crest, on any grid."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    come_to_rest,
    tool_sweep,
)

from msg_bridge.contract.grid import Grid
from soil_sim.slope_failure.stability import critical_height
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import SoilType, load_soil_types

SLOPES = [40.0, 49.0, 60.0, 75.0, 90.0]


@pytest.fixture
def params(tmp_path: Path) -> SoilParams:
    soils = tmp_path / "soils.yaml"
    soils.write_text(
        "weak: {cohesion: 3000.0, density: 1500.0, internal_friction: 20.0, repose_angle: 30.0}"
    )
    return SoilParams(soil="weak", soils=str(soils), soil_depth=1.0)


class Face(NamedTuple):
    """A face between two levels.

    Attributes:
        soil: its soil, before it fails.
        along: distance of each column up the face [m], shape (rows, cols).
        across: distance along the crest from the middle of the map [m], same shape.
        wedge: cross section of Culmann's wedge [m^2].
    """

    soil: Soil
    along: NDArray[np.float64]
    across: NDArray[np.float64]
    wedge: float

    def fail(self) -> float:
        """Let the face come to rest; return the part of the wedge that came loose."""
        columns = self.soil.columns
        firm, volume = columns.firm.copy(), columns.total_mm3
        self.soil.relaxation.mark_all_disturbed()
        come_to_rest(self.soil)
        assert columns.total_mm3 == volume
        assert self.soil.relaxation.max_slope_excess() <= 0.05
        middle = np.abs(self.across) < 1.0
        return float((firm - columns.firm)[middle].sum()) / 1e9 / 2.0 / self.wedge


def soil_type(params: SoilParams) -> SoilType:
    return load_soil_types(params.soils)[params.soil]


def face(params: SoilParams, slope: float, ratio: float, *, cell: float, yaw: float) -> Face:
    """Return a face of a slope and a yaw [deg], and of a ratio of its critical height."""
    kind = soil_type(params)
    beta, phi = math.radians(slope), math.radians(kind.internal_friction)
    height = ratio * float(critical_height(kind.critical_height(0), 0.0, phi, beta))
    cot_plane, cot_face = 1.0 / math.tan(0.5 * (beta + phi)), 1.0 / math.tan(beta)
    size = height * (cot_plane + 1.0) + 6.0
    n, m = int(size / cell) + 1, int((size if yaw else 4.0) / cell) + 1
    grid = Grid(n, m, cell)
    x, y = grid.x(np.arange(n))[:, None], grid.y(np.arange(m))[None, :]
    cos, sin = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    along, across = x * cos + y * sin + 0.5 * height * (cot_plane - 1.0), y * cos - x * sin
    steepness = math.tan(beta) if slope < 90.0 else 1e9
    heights = np.clip(along * steepness, 0.0, height)
    soil = Soil(grid, heights, params)
    return Face(soil, along, across, 0.5 * height**2 * (cot_plane - cot_face))


@pytest.mark.parametrize("yaw", [0.0, 25.0, 45.0])
@pytest.mark.parametrize("slope", SLOPES)
def test_wedge_of_culmann_fails_at_the_critical_height(params, slope: float, yaw: float) -> None:
    cell = 0.1 if slope > 50.0 else 0.2
    assert face(params, slope, 0.95, cell=cell, yaw=yaw).fail() == 0.0
    assert 0.8 <= face(params, slope, 1.05, cell=cell, yaw=yaw).fail() <= 1.15


@pytest.mark.parametrize("cell", [0.2, 0.1, 0.05])
def test_failed_wedge_is_the_same_on_any_grid(params, cell: float) -> None:
    assert 0.8 <= face(params, 90.0, 1.1, cell=cell, yaw=0.0).fail() <= 1.2


def test_failure_comes_to_rest_as_a_fan_before_a_firm_plane(params) -> None:
    wall = face(params, 90.0, 1.05, cell=0.1, yaw=0.0)
    before = wall.soil.columns.height.copy()
    wall.fail()
    columns = wall.soil.columns
    fan = (columns.height > before + 0.01) & (wall.along < 0.0)
    repose = math.tan(math.radians(30.0))
    # The fan of the failed section, at its angle of repose before the face and on the plane.
    reach = math.sqrt(2.0 * wall.wedge / repose)
    assert 0.6 * reach < -wall.along[fan].min() < 1.4 * reach
    assert columns.height.max() <= before.max() + 0.01, "nothing rises"


def test_failure_takes_the_ticks_that_its_budget_needs(params) -> None:
    wall = face(params, 90.0, 1.1, cell=0.05, yaw=0.0)
    soil = Soil(
        wall.soil.grid, wall.soil.columns.height, replace(params, max_cell_visits_per_tick=2000)
    )
    soil.relaxation.mark_all_disturbed()
    before, ticks = soil.total_mm3, 0
    while soil.relaxation.num_pending:
        soil.step(ticks, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        ticks += 1
        assert soil.total_mm3 == soil.columns.total_mm3 == before
    assert ticks > 5


def test_cut_trench_wall_fails_only_once_the_tool_has_left(params) -> None:
    depth = 1.3 * soil_type(params).critical_height(0)
    grid = Grid(121, 61, 0.1)
    soil = Soil(grid, np.zeros(grid.shape), replace(params, soil_depth=5.0))
    box = ((0.0, 0.0), (-1.0, 0.0), (-1.0, 3.0), (0.0, 3.0))
    lost = 0
    for tick in range(40):
        z = -depth * (tick + 1) / 40
        step = soil.step(
            tick,
            tool_sweep(box, (0.0, 0.0, z + depth / 40), (0.0, 0.0, z), 4.0),
            NO_DEPOSIT_REQUESTS,
        )
        lost += int(step.conversions["volume_mm3"].sum(dtype=np.int64))
    ahead = soil.grid.x(np.arange(grid.rows)) > 0.1
    assert soil.columns.height[ahead].min() > -0.05, "the box supports the wall"
    for tick in range(40, 80):
        soil.step(tick, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    assert soil.columns.height[ahead].min() < -0.3 * depth
    trench = soil.columns.height[~ahead & (soil.grid.x(np.arange(grid.rows)) > -1.0)]
    assert trench[:, 25:36].max() > -0.9 * depth, "the wedge lies in the trench"


def test_thin_plate_supports_a_wall_that_would_fail(params) -> None:
    depth = 2.6 * soil_type(params).critical_height(0)
    grid = Grid(81, 61, 0.1)
    soil = Soil(grid, np.zeros(grid.shape), replace(params, soil_depth=5.0))
    plate = ((0.0, 0.0), (0.0, 5.0))
    for tick in range(60):
        x = -1.0 + 0.02 * tick
        sweep = tool_sweep(plate, (x, 0.0, -depth), (x + 0.02, 0.0, -depth), 7.0)
        soil.step(tick, sweep, NO_DEPOSIT_REQUESTS)
    ahead = grid.x(np.arange(grid.rows)) > 0.35
    assert not soil.columns.loose[ahead].any()
    for tick in range(60, 80):
        soil.step(tick, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    assert soil.columns.loose[ahead].any()
