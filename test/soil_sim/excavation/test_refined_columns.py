"""Slots of columns that a tool is in."""

import numpy as np

from soil_sim.excavation.refined_columns import RefinedColumns


def refined(cells: list[int], last_ticks: list[int], tick: int) -> RefinedColumns:
    """Return refined columns of 2 x 2 subcolumns, with the last tick that a tool was in each."""
    columns = RefinedColumns(50, 2)
    columns.count, columns.tick = len(cells), tick
    tables = columns.arrays
    for slot, (cell, last) in enumerate(zip(cells, last_ticks, strict=True)):
        tables.slot_of[cell], tables.cells[slot], tables.last_tick[slot] = slot, cell, last
        tables.mean_height[slot], tables.initial_height[slot] = 0.1 * cell, 1.0 * cell
        tables.subcolumn_height[slot] = cell + np.arange(4)
    return columns


def test_columns_without_a_tool_are_freed_and_the_others_keep_their_shape() -> None:
    columns = refined([40, 7, 30, 9, 2], [5, 4, 5, 3, 5], tick=5)
    kept, freed = columns.end_tick()
    tables = columns.arrays
    assert (kept.tolist(), freed.tolist()) == ([40, 30, 2], [7, 9])
    assert columns.count == 3
    assert tables.slot_of[[40, 30, 2]].tolist() == [0, 1, 2]
    assert (np.delete(tables.slot_of, [40, 30, 2]) == -1).all()
    assert tables.initial_height[:3].tolist() == [40.0, 30.0, 2.0]
    assert np.allclose(tables.mean_height[:3], [4.0, 3.0, 0.2])
    assert np.array_equal(tables.subcolumn_height[:3], np.array([[40], [30], [2]]) + np.arange(4))
    assert tables.last_tick[:3].tolist() == [5, 5, 5]


def test_columns_are_freed_one_tick_after_the_tool_left() -> None:
    columns = refined([40, 7], [5, 5], tick=5)
    columns.end_tick()
    kept, freed = columns.end_tick()
    assert (kept.tolist(), freed.tolist(), columns.count) == ([], [7, 40], 0)
    assert (columns.arrays.slot_of == -1).all()
    assert columns.end_tick()[1].size == 0
