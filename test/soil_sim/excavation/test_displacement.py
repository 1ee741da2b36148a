"""Soil that a tool has no room for is pushed ahead, exactly, and flows to the sides."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    bucket_sweep,
    excavated_mm3,
    flat_soil,
    make_deposit_requests,
    tool_sweep,
)

from msg_bridge.contract.rows import UNLIMITED_ROOM, Rows
from soil_sim.columns.occupancy import TOOL_INSIDE
from soil_sim.excavation.displacement import nearest_free_column, split_by_room
from soil_sim.excavation.removed_soil import REMOVED_SOIL
from soil_sim.soil import Soil

BLADE = ((0.0, 0.0), (-0.05, 0.4), (0.0, 0.8))
DEPTH = 0.15
WIDTH = 2.0


def with_room(sweep: Rows, room_mm3: int) -> Rows:
    """Return the sweep of a tool with a room."""
    sweep["room_mm3"] = room_mm3
    return sweep


def push(
    soil: Soil,
    profile: Sequence[tuple[float, float]],
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    *,
    room_mm3: int = 0,
    width: float = WIDTH,
    step: float = 0.02,
) -> tuple[int, NDArray[np.float64]]:
    """Move a tool along a line.

    Returns:
        (excavated volume [mm^3], force against +x in each tick [N]).
    """
    a, b = np.array(start), np.array(end)
    count = round(float(np.linalg.norm(b - a)) / step)
    path = [tuple((a + k / count * (b - a)).tolist()) for k in range(count + 1)]
    excavated, forces = 0, []
    for tick in range(count):
        sweep = with_room(tool_sweep(profile, path[tick], path[tick + 1], width), room_mm3)
        done = soil.step(tick, sweep, NO_DEPOSIT_REQUESTS)
        assert done.rejected_tools == ()
        excavated += excavated_mm3(done)
        forces.append(-float(done.forces["fx"][0]))
    return excavated, np.array(forces)


def soil_in(soil: Soil, x: tuple[float, float], y: tuple[float, float]) -> NDArray[np.float64]:
    """Return the heights of the columns in a rectangle [m]."""
    grid = soil.grid
    i, j = grid.x(np.arange(grid.rows)), grid.y(np.arange(grid.cols))
    return soil.columns.height[np.ix_((i > x[0]) & (i < x[1]), (j > y[0]) & (j < y[1]))]


@pytest.mark.parametrize("room_mm3", [0, 1, 12_345_678])
def test_tool_takes_in_no_more_than_its_room(room_mm3: int) -> None:
    soil = flat_soil(6.0, 0.2)
    before = soil.total_mm3
    sweep = with_room(bucket_sweep((0, 0, -0.1), (0.2, 0, -0.3)), room_mm3)
    assert excavated_mm3(soil.step(0, sweep, NO_DEPOSIT_REQUESTS)) == room_mm3
    assert soil.total_mm3 == soil.columns.total_mm3 == before - room_mm3


def test_tool_with_room_pushes_nothing() -> None:
    soils = flat_soil(6.0, 0.2), flat_soil(6.0, 0.2)
    sweep = bucket_sweep((0, 0, -0.1), (0.2, 0, -0.3))
    volume = excavated_mm3(soils[0].step(0, sweep, NO_DEPOSIT_REQUESTS))
    assert excavated_mm3(soils[1].step(0, with_room(sweep, volume), NO_DEPOSIT_REQUESTS)) == volume
    assert soils[0].state_hash() == soils[1].state_hash()
    assert volume < UNLIMITED_ROOM


def test_blade_leaves_a_trench_with_a_windrow_on_both_sides() -> None:
    soil = flat_soil(10.0, 0.1, swell=0.2)
    before = soil.total_mm3
    excavated, _ = push(soil, BLADE, (-3.0, 0, -DEPTH), (1.5, 0, -DEPTH))
    assert excavated == 0
    assert soil.total_mm3 == soil.columns.total_mm3 == before
    trench = soil_in(soil, (-2.0, 0.5), (-0.4, 0.4))  # the windrows slide into its sides
    assert trench.max() < -0.8 * DEPTH
    for side in ((1.0, 2.0), (-2.0, -1.0)):
        windrow = soil_in(soil, (-2.0, 0.5), side).sum() * 0.1**2
        assert windrow > 0.2 * 0.5 * WIDTH * DEPTH * 2.5, "a fifth of half of the trench"
    assert soil_in(soil, (1.5, 3.0), (-1.0, 1.0)).max() > 0.2, "a heap ahead"


def test_heap_ahead_of_a_blade_reaches_a_steady_state_and_resists() -> None:
    soil = flat_soil(12.0, 0.1, swell=0.2)
    _, forces = push(soil, BLADE, (-5.0, 0, -DEPTH), (4.0, 0, -DEPTH))
    start, middle, end = forces[10:30].mean(), forces[200:260].mean(), forces[-60:].mean()
    assert middle > 1.5 * start
    assert end == pytest.approx(middle, rel=0.35)


def test_bucket_moved_sideways_pushes_soil_ahead_of_its_side() -> None:
    soil = flat_soil(6.0, 0.1)
    for tick in range(50):
        sweep = bucket_sweep((0, 0.02 * tick, -0.2), (0, 0.02 * (tick + 1), -0.2))
        soil.step(tick, with_room(sweep, 0), NO_DEPOSIT_REQUESTS)
    side = 1.0 + 0.6
    assert soil_in(soil, (-0.6, 0.0), (side, side + 0.3)).max() > 0.1
    assert soil_in(soil, (-0.6, 0.0), (0.6, 0.9)).max() < -0.1


def rotated(sweep: Rows, yaw: float) -> Rows:
    """Return a sweep turned about the z axis by an angle [rad]."""
    turned = sweep.copy()
    for end in "01":
        x, y = sweep[f"x{end}"], sweep[f"y{end}"]
        turned[f"x{end}"] = math.cos(yaw) * x - math.sin(yaw) * y
        turned[f"y{end}"] = math.sin(yaw) * x + math.cos(yaw) * y
    return turned


@pytest.mark.parametrize("yaw", [0, 20, 45])
@pytest.mark.parametrize("cell", [0.2, 0.1, 0.05])
def test_plate_retains_the_sand_ahead_of_it(cell: float, yaw: float) -> None:
    soil = flat_soil(6.0, cell, soil="dry sand")
    upright, depth, swept = ((0.0, 0.0), (0.0, 2.0)), 0.3, 0
    for tick in range(60):
        x = -0.6 + 0.02 * tick
        sweep = tool_sweep(upright, (x, 0, -depth), (x + 0.02, 0, -depth), WIDTH)
        swept += excavated_mm3(
            soil.step(tick, rotated(sweep, math.radians(yaw)), NO_DEPOSIT_REQUESTS)
        )
    assert swept == pytest.approx(1.2 * depth * WIDTH * 1e9, rel=0.02)


def test_thin_blade_at_rest_holds_the_soil_ahead_of_it() -> None:
    soil = flat_soil(6.0, 0.1)
    push(soil, BLADE, (-1.5, 0, -DEPTH), (0.5, 0, -DEPTH))
    behind = soil_in(soil, (-0.5, 0.3), (-0.6, 0.6)).copy()
    berm = soil_in(soil, (0.6, 1.5), (-0.6, 0.6)).copy()
    assert berm.max() > 0.1
    for tick in range(100, 120):
        sweep = tool_sweep(BLADE, (0.5, 0, -DEPTH), (0.5, 0, -DEPTH), WIDTH)
        soil.step(tick, with_room(sweep, 0), NO_DEPOSIT_REQUESTS)
    assert np.array_equal(soil_in(soil, (-0.5, 0.3), (-0.6, 0.6)), behind)
    assert np.array_equal(soil_in(soil, (0.6, 1.5), (-0.6, 0.6)), berm)


def test_soil_fails_once_a_tool_has_left() -> None:
    soil = flat_soil(6.0, 0.1)
    push(soil, BLADE, (-1.5, 0, -DEPTH), (0.5, 0, -DEPTH))
    for tick in range(100, 103):
        soil.step(tick, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    assert not soil.relaxation.occupied.any()
    assert soil.relaxation.num_pending == 0
    assert soil.relaxation.max_slope_excess() < 0.05


@pytest.mark.parametrize("end", [(5.0, 0.0), (0.0, 5.0), (4.0, 4.0)])
def test_soil_pushed_against_the_edge_stays_on_the_map(end: tuple[float, float]) -> None:
    soil = flat_soil(4.0, 0.2)
    before = soil.total_mm3
    excavated, _ = push(soil, BLADE, (0, 0, -0.3), (*end, -0.3), step=0.05)
    assert excavated == 0
    assert soil.total_mm3 == soil.columns.total_mm3 == before


def test_tool_over_the_entire_map_leaves_the_soil_where_it_is() -> None:
    soil = flat_soil(2.0, 0.2)
    before = soil.total_mm3
    plate = ((0.0, 0.0), (-3.0, 0.0), (-3.0, 0.1))
    for tick in range(3):
        z = -0.1 * tick
        sweep = tool_sweep(plate, (1.5, 0, z), (1.5, 0, z - 0.1), 3.0)
        soil.step(tick, with_room(sweep, 0), NO_DEPOSIT_REQUESTS)
    assert soil.total_mm3 == soil.columns.total_mm3 == before


def test_tool_at_rest_takes_in_nothing_that_falls_on_it() -> None:
    soil = flat_soil(6.0, 0.2)
    soil.step(0, bucket_sweep((0.0, 0, 0.1), (0.1, 0, -0.3)), NO_DEPOSIT_REQUESTS)
    before = soil.total_mm3
    x = np.linspace(-0.9, 0.3, 12)
    poured = make_deposit_requests(x, 0.0 * x, 20_000_000)
    at_rest = bucket_sweep((0.1, 0, -0.3), (0.1, 0, -0.3))
    assert excavated_mm3(soil.step(1, with_room(at_rest, 10**9), poured)) == 0
    for tick in range(2, 10):
        at_rest = with_room(bucket_sweep((0.1, 0, -0.3), (0.1, 0, -0.3)), 10**9)
        assert excavated_mm3(soil.step(tick, at_rest, NO_DEPOSIT_REQUESTS)) == 0
    assert soil.total_mm3 == before + 12 * 20_000_000


def test_split_is_exact_and_leaves_out_empty_records() -> None:
    removed = np.zeros(4, dtype=REMOVED_SOIL)
    removed["cell"], removed["volume_mm3"] = np.arange(4), (1, 10**12 + 7, 1, 3 * 10**12)
    total = int(removed["volume_mm3"].sum())
    taken, rest = split_by_room(removed.copy(), 2**32 - 2)
    assert int(taken["volume_mm3"].sum()) == 2**32 - 2
    assert int(taken["volume_mm3"].sum() + rest["volume_mm3"].sum()) == total
    assert (taken["volume_mm3"] > 0).all()
    assert (rest["volume_mm3"] > 0).all()


def test_nearest_free_column_is_the_nearest() -> None:
    soil = flat_soil(4.0, 0.2)
    frame, occupied = soil.columns.frame, soil.relaxation.occupied.copy()
    occupied[5:12, 3:15] = TOOL_INSIDE
    found = nearest_free_column(8 * frame.cols + 5, occupied.reshape(-1), frame)
    assert divmod(found, frame.cols) == (8, 2)
    occupied[:] = TOOL_INSIDE
    assert nearest_free_column(7, occupied.reshape(-1), frame) == 7
