"""Volume that a swept cut removes, at any grid, speed and orientation; the key-point cut."""

import math

import numpy as np
import pytest
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    bucket_sweep,
    drag_tool,
    excavated_mm3,
    flat_soil,
    scoop,
    tool_sweep,
)

from msg_bridge.contract.rows import ConversionKind, SoilReaction, SweepAction
from soil_sim.excavation import SweptCut
from soil_sim.excavation.keypoint_cut import collision_points
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.sweep_validation import validate_sweeps
from soil_sim.tool_sweeps import group_by_machine


def test_drag_removes_the_swept_volume() -> None:
    # At a steep angle of repose a 1.2 m bucket dragged 3 m at 0.3 m depth cuts a slot.
    soil = flat_soil(12.0, 0.1, repose_angle=80.0)
    excavated = scoop(soil, depth=0.3, length=3.0)
    slot = 1.2 * (0.3 * 3.0 + 0.215)  # 0.215 m^2 is the profile of the bucket where it entered
    assert excavated / 1e9 == pytest.approx(slot, rel=1e-3)


@pytest.mark.parametrize("cell", [0.4, 0.2, 0.05])
def test_excavated_volume_does_not_depend_on_the_grid(cell: float) -> None:
    fine = scoop(flat_soil(9.0, 0.1), depth=0.3, length=3.0)
    assert scoop(flat_soil(9.0, cell), depth=0.3, length=3.0) == pytest.approx(fine, rel=0.01)


def test_excavated_volume_does_not_depend_on_speed() -> None:
    slow = scoop(flat_soil(9.0, 0.2), depth=0.3, length=3.0, speed=0.5)
    fast = scoop(flat_soil(9.0, 0.2), depth=0.3, length=3.0, speed=8.0)
    assert fast == pytest.approx(slow, rel=0.01)


def test_conversions_are_the_volumes_removed_from_the_columns() -> None:
    soil = flat_soil(6.0, 0.2)
    before = soil.columns.firm + soil.columns.loose
    start = soil.total_mm3
    step = soil.step(4, bucket_sweep((0, 0, 0.1), (0.05, 0.02, -0.12)), NO_DEPOSIT_REQUESTS)
    rows = step.conversions
    assert (rows["kind"] == ConversionKind.EXCAVATE).all()
    assert (rows["tick"] == 4).all()
    assert soil.total_mm3 == start - int(rows["volume_mm3"].sum())
    assert soil.verify_volume()
    lost = before - soil.columns.firm - soil.columns.loose
    assert np.array_equal(lost[rows["row"], rows["col"]], rows["volume_mm3"])
    assert lost.sum() == rows["volume_mm3"].sum()


def test_excavated_soil_is_between_tool_and_surface() -> None:
    soil = flat_soil(6.0, 0.2)
    rows = soil.step(0, bucket_sweep((0, 0, 0.1), (0, 0, -0.2)), NO_DEPOSIT_REQUESTS).conversions
    assert rows.size > 5
    assert (rows["z"] < 0).all()
    assert (rows["z"] > -0.2).all()
    assert (np.abs(rows["y"]) <= 0.6).all()


def test_tool_above_the_ground_removes_nothing() -> None:
    soil = flat_soil(6.0, 0.2)
    step = soil.step(0, bucket_sweep((0, 0, 0.5), (1, 0, 0.01)), NO_DEPOSIT_REQUESTS)
    assert step.conversions.size == 0
    assert step.map_updates.size == 0
    assert soil.revision == 0


def test_every_tool_has_a_force_row() -> None:
    sweep = bucket_sweep((0, 0, 0.1), (0, 0, -0.2))
    forces = flat_soil(6.0, 0.2).step(0, sweep, NO_DEPOSIT_REQUESTS).forces
    forces = forces[forces["reaction"] == SoilReaction.CUT]
    assert forces.size == 1
    assert forces["machine_id"][0] == 1
    assert not forces["fx"].any()


def test_compacting_tool_does_not_cut() -> None:
    sweep = bucket_sweep((0, 0, 0.1), (0, 0, -0.2))
    sweep["action"] = SweepAction.COMPACT
    assert flat_soil(6.0, 0.2).step(0, sweep, NO_DEPOSIT_REQUESTS).conversions.size == 0


def test_soil_slides_into_the_space_of_a_tool_only_after_the_tool_left() -> None:
    soil = flat_soil(6.0, 0.1)
    soil.step(0, bucket_sweep((0, 0, 0.05), (0, 0, -0.5)), NO_DEPOSIT_REQUESTS)
    i, j = int(soil.grid.row(-0.2)), int(soil.grid.col(0.0))
    assert soil.columns.height[i, j] == pytest.approx(-0.5, abs=0.01)
    soil.step(1, bucket_sweep((0, 0, -0.5), (0, 0, -0.5)), NO_DEPOSIT_REQUESTS)
    assert soil.columns.height[i, j] == pytest.approx(-0.5, abs=0.01)
    for tick in range(2, 40):
        soil.step(tick, bucket_sweep((0, 0, 2.0), (0, 0, 2.0)), NO_DEPOSIT_REQUESTS)
    assert soil.columns.height[i, j] > -0.4
    assert not soil.relaxation.occupied.any()


@pytest.mark.parametrize("cell", [0.2, 0.05])
@pytest.mark.parametrize("resolution", [0.1, 0.05, 0.025])
@pytest.mark.parametrize("pitch", [0, 5, 20, 45, 70, 85, 88, 90, 92, 100, 110])
def test_plate_removes_the_swept_volume_at_any_pitch(
    pitch: float, resolution: float, cell: float
) -> None:
    # Pitched up about its lip: at 0 it lies behind the lip, beyond 90 degrees it overhangs.
    length, depth = 0.5, 0.3
    back, up = -length * math.cos(math.radians(pitch)), length * math.sin(math.radians(pitch))
    soil = flat_soil(4.0, cell, cut_resolution=resolution)
    removed = drag_tool(soil, [(0.0, 0.0), (back, up)], depth=depth, step=0.01)
    # At its first pose (or, overhanging, the last) it also removes the soil above it.
    buried = min(length, depth / math.sin(math.radians(pitch)) if pitch else length)
    above = depth - 0.5 * buried * math.sin(math.radians(pitch))
    bed = buried * abs(math.cos(math.radians(pitch))) * above
    assert removed == pytest.approx(1.2 * (depth * 1.0 + bed), rel=0.03)


@pytest.mark.parametrize("step", [0.002, 0.01, 0.1, 1.0])
def test_upright_blade_removes_the_swept_volume_at_any_speed(step: float) -> None:
    soil = flat_soil(4.0, 0.2)
    removed = drag_tool(soil, [(0.0, 0.0), (0.0, 0.6)], depth=0.3, step=step)
    assert removed == pytest.approx(0.36, rel=0.03)


def test_tool_of_one_pair_cuts() -> None:
    removed = drag_tool(flat_soil(4.0, 0.2), [(0.0, 0.0)], depth=0.3, step=0.01)
    assert removed == pytest.approx(0.36, rel=0.03)


def test_plate_turned_on_its_side_cuts_with_its_side() -> None:
    # Its pairs are vertical, and one of its sides leads, 0.3 m deep.
    soil = flat_soil(4.0, 0.2)
    soil.relaxation.is_enabled = False
    start = soil.total_mm3
    for tick in range(100):
        sweep = tool_sweep([(0, 0), (0, 0)], (0, 0, 0), (0, 0, 0))
        x = -0.5 + 0.01 * tick
        sweep["x0"], sweep["x1"] = x, x + 0.01
        sweep["y0"] = sweep["y1"] = [0.6, 0.6, -0.6, -0.6]
        sweep["z0"] = sweep["z1"] = [-0.3, 0.3, -0.3, 0.3]
        soil.step(tick, sweep, NO_DEPOSIT_REQUESTS)
    assert (start - soil.total_mm3) / 1e9 == pytest.approx(0.36, rel=0.03)


def test_upright_blade_at_rest_occupies_its_columns() -> None:
    soil = flat_soil(4.0, 0.2)
    soil.step(0, tool_sweep([(0, 0), (0, 0.6)], (0, 0, -0.3), (0, 0, -0.3)), NO_DEPOSIT_REQUESTS)
    i = int(round(float(soil.grid.row(0.0))))
    assert soil.relaxation.occupied[i].sum() == 7
    assert soil.relaxation.occupied.sum() == 7


def test_column_is_levelled_when_the_tool_has_left() -> None:
    soil = flat_soil(4.0, 0.2)
    soil.relaxation.is_enabled = False
    blade = [(0.0, 0.0), (0.0, 0.6)]
    first_half = tool_sweep(blade, (-0.1, 0, -0.3), (0.0, 0, -0.3), width=1.0)
    second_half = tool_sweep(blade, (0.0, 0, -0.3), (0.1, 0, -0.3), width=1.0)
    above = tool_sweep(blade, (0.0, 0, 2.0), (0.0, 0, 2.0))
    first, _, second = (
        excavated_mm3(soil.step(k, sweep, NO_DEPOSIT_REQUESTS))
        for k, sweep in enumerate((first_half, above, second_half))
    )
    assert second == pytest.approx(0.5 * first, rel=0.03)


def test_tools_far_apart_do_not_reserve_the_columns_between_them() -> None:
    columns = flat_soil(40.0, 0.1).columns
    cut = SweptCut(columns, np.zeros(columns.grid.shape, dtype=np.uint8), resolution=0.025)
    sweep = np.concatenate([tool_sweep([(0, 0)], (x, x, -0.1), (x, x, -0.1)) for x in (-19, 19)])
    sweep["tool"] = [1, 1, 2, 2]
    (machine,) = group_by_machine(validate_sweeps(sweep)[0])
    before = cut.capacity
    cut.reserve(machine.cuts)
    for sweep_of_tool in machine.cuts:
        cut.excavate(sweep_of_tool)
    cut.end_tick()
    assert cut.occupied.any()
    assert cut.capacity == before


def test_floor_cannot_be_dug() -> None:
    soil = flat_soil(6.0, 0.2, soil_depth=0.15)
    soil.step(0, bucket_sweep((0, 0, 0.1), (0, 0, -5.0)), NO_DEPOSIT_REQUESTS)
    assert soil.columns.height.min() >= soil.columns.floor - 1e-9
    assert soil.columns.firm.min() >= 0


def test_keypoint_cut_has_56_collision_points() -> None:
    points = collision_points(bucket_sweep((0, 0, 0), (0, 0, -0.1)), 8)
    assert points.shape == (56, 3)
    assert np.abs(points[:, 1]).max() == pytest.approx(0.6 - 1.2 / 9, abs=1e-6)


@pytest.mark.parametrize(("cell", "width"), [(0.2, 1.34), (0.1, 1.14)])
def test_keypoint_cut_is_wider_on_coarse_grids(cell: float, width: float) -> None:
    soil = flat_soil(6.0, cell, cut_mode="reference", repose_angle=80.0)
    start = soil.total_mm3
    widths = []
    for k in range(80):
        y = 0.001 * k  # positions of the bucket relative to the grid
        soil = flat_soil(6.0, cell, cut_mode="reference", repose_angle=80.0)
        step = soil.step(0, bucket_sweep((0, y, 0.1), (0, y, -0.2)), NO_DEPOSIT_REQUESTS)
        assert soil.total_mm3 == start - excavated_mm3(step)
        widths.append(np.unique(step.conversions["col"]).size * cell)
    assert np.mean(widths) == pytest.approx(width, abs=0.1)


@pytest.mark.parametrize("seed", range(8))
def test_single_column_that_reaches_the_tool_is_cut_as_in_level_ground(seed: int) -> None:
    # A tool above all columns is skipped; a single column that reaches it must not be missed.
    rng = np.random.default_rng(seed)
    start = np.append(rng.uniform(-0.5, 0.5, 2), 0.2)
    end = start + np.append(rng.uniform(-0.3, 0.3, 2), -0.25)
    sweep = bucket_sweep(tuple(start), tuple(end))
    level = flat_soil(6.0, 0.1, repose_angle=80.0)
    rows = level.step(0, sweep, NO_DEPOSIT_REQUESTS).conversions
    expected = rows[rng.integers(rows.size)]
    heights = np.full(level.grid.shape, -1.0)
    heights[expected["row"], expected["col"]] = 0.0
    single = Soil(level.grid, heights, SoilParams(repose_angle=80.0, soil_depth=19.0))
    removed = single.step(0, sweep, NO_DEPOSIT_REQUESTS).conversions
    assert removed.size == 1
    assert removed[0] == expected
