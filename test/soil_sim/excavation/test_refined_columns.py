"""Slots of columns that a tool stands in."""

import numpy as np

from soil_sim.excavation.refined_columns import RefinedColumns


def refined(cells: list[int], seen: list[int], tick: int) -> RefinedColumns:
    """Columns in slots, each of 2 x 2 subcolumns, last seen in these ticks."""
    columns = RefinedColumns(50, 2)
    columns.count, columns.tick = len(cells), tick
    for slot, (cell, last) in enumerate(zip(cells, seen, strict=True)):
        tables = columns.arrays
        tables.slot_of[cell], tables.cells[slot], tables.last_tick[slot] = slot, cell, last
        tables.mean_height[slot], tables.initial_height[slot] = 0.1 * cell, 1.0 * cell
        tables.subcolumn_height[slot] = cell + np.arange(4)
    return columns


def test_columns_no_tool_was_in_are_freed_and_the_others_keep_their_shape() -> None:
    columns = refined([40, 7, 30, 9, 2], [5, 4, 5, 3, 5], tick=5)
    stay, gone = columns.end_tick()
    tables = columns.arrays
    assert (stay.tolist(), gone.tolist()) == ([40, 30, 2], [7, 9])
    assert columns.count == 3
    assert tables.slot_of[[40, 30, 2]].tolist() == [0, 1, 2]
    assert (np.delete(tables.slot_of, [40, 30, 2]) == -1).all()
    assert tables.initial_height[:3].tolist() == [40.0, 30.0, 2.0]
    assert np.allclose(tables.mean_height[:3], [4.0, 3.0, 0.2])
    assert np.array_equal(tables.subcolumn_height[:3], np.array([[40], [30], [2]]) + np.arange(4))
    assert tables.last_tick[:3].tolist() == [5, 5, 5]


def test_a_tick_later_all_that_were_not_seen_again_are_freed() -> None:
    columns = refined([40, 7], [5, 5], tick=5)
    columns.end_tick()
    stay, gone = columns.end_tick()
    assert (stay.tolist(), gone.tolist(), columns.count) == ([], [7, 40], 0)
    assert (columns.arrays.slot_of == -1).all()
    assert columns.end_tick()[1].size == 0
