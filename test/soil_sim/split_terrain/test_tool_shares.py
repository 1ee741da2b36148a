"""Room and work of a tool over a border are divided among the regions, and none is added."""

from __future__ import annotations

import numpy as np
import pytest
from support.soil_scenes import tool_sweep

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import UNLIMITED_ROOM, Rows, SweepAction
from soil_sim.split_terrain.slabs import split_into_slabs
from soil_sim.split_terrain.tool_shares import SharedSweeps, share_sweeps
from soil_sim.sweep_validation import validate_sweeps

GRID = Grid(96, 48, 0.1)
SLABS = split_into_slabs(GRID, 3, 16)  # borders at x = 1.6 and -1.6 m
SQUARE = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5))
"""(x, z) of the key points of a drum from its axis [m]."""


def share(rows: Rows) -> SharedSweeps:
    """Divide the sweep of one tool."""
    valid, rejected = validate_sweeps(rows)
    assert rejected == ()
    return share_sweeps(valid, GRID, SLABS)


def blade_along_x(x: float, room: int) -> Rows:
    """Return the sweep of a blade 2 m wide, parallel to x, whose middle is at `x` [m]."""
    rows = tool_sweep([(0.0, 0.0), (0.0, 0.5)], (x, 0.0, -0.1), (x, 0.01, -0.1))
    rows["x0"] = rows["x1"] = x + np.tile([1.0, -1.0], 2)
    rows["y0"], rows["y1"] = 0.0, 0.01
    rows["room_mm3"] = room
    return rows


@pytest.mark.parametrize(("x", "parts"), [(1.6, [0.5, 0.5, 0.0]), (-1.9, [0.0, 0.35, 0.65])])
def test_room_is_divided_by_the_length_of_the_lip(x: float, parts: list[float]) -> None:
    room = 1_000_001
    shared = share(blade_along_x(x, room))
    rooms = [int(rows["room_mm3"][0]) if rows.size else 0 for rows in shared.rows]
    assert sum(rooms) == room
    assert np.array(rooms) / room == pytest.approx(parts, abs=0.05)
    assert shared.owners == {(1, 0): int(np.argmax(parts))}


def test_tool_that_is_near_a_region_retains_soil_there_without_room() -> None:
    shared = share(blade_along_x(3.0, 1_000_000))
    rooms = [rows["room_mm3"].tolist() for rows in shared.rows]
    assert rooms == [[1_000_000] * 4, [0] * 4, []]


def test_tool_with_unlimited_room_has_it_in_each_region() -> None:
    shared = share(blade_along_x(1.6, UNLIMITED_ROOM))
    assert [rows["room_mm3"][0] for rows in shared.rows[:2]] == [UNLIMITED_ROOM] * 2


def test_work_of_a_drum_is_divided_by_its_surface() -> None:
    rows = tool_sweep(SQUARE, (1.6, 0.0, 0.0), (1.61, 0.0, 0.0))
    rows["action"], rows["work"] = SweepAction.MILL, 900.0
    shared = share(rows)
    works = [float(rows["work"][0]) for rows in shared.rows[:2]]
    assert sum(works) == pytest.approx(900.0, rel=1e-6)
    assert works[0] == pytest.approx(450.0, rel=0.1)
