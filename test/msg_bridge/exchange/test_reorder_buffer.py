"""Rows beyond a gap are kept until it is filled."""

import numpy as np

from msg_bridge.contract.messages import RowRange
from msg_bridge.contract.rows import DEPOSIT_REQUEST, empty_rows
from msg_bridge.exchange.reorder_buffer import ReorderBuffer


def early(*numbers: int) -> ReorderBuffer:
    rows = ReorderBuffer(DEPOSIT_REQUEST)
    assert rows.add(*marked(*numbers)) == len(numbers)
    return rows


def marked(*numbers: int, mark: int = 0):
    rows = empty_rows(DEPOSIT_REQUEST, len(numbers))
    rows["particle_id"] = np.array(numbers) + mark
    return np.array(numbers), rows


def test_of_duplicate_rows_the_first_counts():
    rows = early(5, 3)
    assert rows.add(*marked(4, 5, 4, mark=100)) == 1
    assert rows.pop_contiguous(3)["particle_id"].tolist() == [3, 104, 5]
    assert not rows


def test_rows_are_removed_up_to_the_next_gap():
    rows = early(9, 4, 6, 5)
    assert rows.pop_contiguous(3).size == 0
    assert rows.pop_contiguous(4)["particle_id"].tolist() == [4, 5, 6]
    assert len(rows) == 1


def test_rows_older_than_the_removed_ones_are_dropped():
    rows = early(4, 5, 6, 9)
    assert rows.pop_contiguous(6)["particle_id"].tolist() == [6]
    assert rows.pop_contiguous(7).size == 0
    assert rows.pop_contiguous(9)["particle_id"].tolist() == [9]


def test_gaps_are_listed_within_a_range():
    rows = early(4, 5, 8)
    assert rows.missing(RowRange(3, 8)) == [RowRange(3, 1), RowRange(6, 2), RowRange(9, 2)]
    assert rows.missing(RowRange(5, 2)) == [RowRange(6, 1)]
    assert rows.missing(RowRange(4, 2)) == []
    assert rows.missing(RowRange(20, 0)) == []
