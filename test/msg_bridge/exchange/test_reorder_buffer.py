"""Rows beyond a gap are kept until it is filled."""

import time

import numpy as np

from msg_bridge.contract.messages import RowRange
from msg_bridge.contract.rows import DEPOSIT_REQUEST, empty_rows
from msg_bridge.exchange.reorder_buffer import MAX_ROWS_AHEAD, ReorderBuffer


def early(*numbers: int) -> ReorderBuffer:
    rows = ReorderBuffer(DEPOSIT_REQUEST, first=3)
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


def test_gaps_beyond_the_last_row_are_listed():
    rows = early(4, 2000)
    assert rows.missing(RowRange(4, 100_000)) == [RowRange(5, 1995), RowRange(2001, 98_003)]
    assert rows.missing(RowRange(500_000, 3)) == [RowRange(500_000, 3)]
    assert early().missing(RowRange(3, 5)) == [RowRange(3, 5)]


def test_rows_too_far_ahead_are_dropped():
    rows = early()
    last = 3 + MAX_ROWS_AHEAD - 1
    assert rows.add(*marked(last, last + 1, last + 1_000_000)) == 1
    assert rows.pop_contiguous(last)["particle_id"].tolist() == [last]


def test_rows_in_any_order_are_removed_as_from_a_set():
    rng = np.random.default_rng(0)
    rows, kept, first = ReorderBuffer(DEPOSIT_REQUEST, first=1), set(), 1
    for _ in range(300):
        numbers = rng.integers(first, first + 60, 20)
        rows.add(*marked(*numbers))
        kept |= set(numbers.tolist())
        taken = rows.pop_contiguous(first)["particle_id"].tolist()
        assert taken == list(range(first, first + len(taken)))
        first += len(taken)
        kept -= set(taken)
        assert first not in kept
        assert len(rows) == len(kept)
        gaps = {
            n for gap in rows.missing(RowRange(first, 60)) for n in range(gap.first, gap.last + 1)
        }
        assert gaps == set(range(first, first + 60)) - kept
    assert first > 1000


def test_adding_rows_does_not_take_longer_the_more_are_kept():
    numbers = np.arange(MAX_ROWS_AHEAD)
    full, empty = (ReorderBuffer(DEPOSIT_REQUEST, first=0) for _ in range(2))
    full.add(*marked(*numbers[1:]))
    empty.add(*marked(MAX_ROWS_AHEAD - 1))
    some = marked(*numbers[5000:5100])

    def duration(rows):
        start = time.process_time()
        for _ in range(200):
            rows.add(*some)
            rows.pop_contiguous(0)
        return time.process_time() - start

    assert min(duration(full) for _ in range(3)) < 20 * min(duration(empty) for _ in range(3))
