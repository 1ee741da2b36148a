"""Loops that work on a vector at a time, compared with NumPy."""

import numpy as np
import pytest
from numba import njit

from machine_sim.dem.compaction import (
    COMPACTION_SIZE,
    append_marked,
    append_pairs,
    copy_vector,
    find_value,
    move_rows,
)

BEGIN, COUNT = 5, 3
"""First of the values that are appended, and number of values in the list before."""
UNUSED = 999


@njit
def append(values, mark, out):
    return append_marked(values, mark, BEGIN, out, COUNT)


@njit
def append_with(own, values, mark, first, second):
    return append_pairs(own, values, mark, BEGIN, first, second, COUNT)


@njit
def copy(source, begin, target, at):
    copy_vector(source, begin, target, at)


@njit
def find(values, count, wanted):
    return find_value(values, BEGIN, count, wanted)


@njit
def move(array, source, target, count):
    move_rows(array, source, target, count)


def marked_values(num_marked):
    """Return values and marks, of which a number are set among those that are appended."""
    values = np.arange(100, 100 + BEGIN + COMPACTION_SIZE, dtype=np.uint32)
    mark = np.ones(len(values), np.uint8)
    mark[BEGIN:] = 0
    chosen = np.random.default_rng(num_marked).permutation(COMPACTION_SIZE)[:num_marked]
    mark[BEGIN + chosen] = 1
    return values, mark, values[BEGIN:][mark[BEGIN:] != 0]


@pytest.mark.parametrize("num_marked", [0, 1, 7, COMPACTION_SIZE])
def test_marked_values_are_appended_in_order_and_nothing_behind_them(num_marked):
    values, mark, expected = marked_values(num_marked)
    out = np.full(COUNT + COMPACTION_SIZE, UNUSED, np.uint32)
    assert append(values, mark, out) == COUNT + num_marked
    assert list(out[COUNT : COUNT + num_marked]) == list(expected)
    assert set(out[:COUNT]) | set(out[COUNT + num_marked :]) <= {UNUSED}


def test_pairs_with_marked_values_are_appended():
    values, mark, expected = marked_values(6)
    first, second = (np.full(COUNT + COMPACTION_SIZE + 1, UNUSED, np.uint32) for _ in range(2))
    assert append_with(np.uint32(8), values, mark, first, second) == COUNT + 6
    assert list(first[COUNT : COUNT + 6]) == [8] * 6
    assert list(second[COUNT : COUNT + 6]) == list(expected)
    for values in first, second:
        assert {*values[:COUNT], *values[COUNT + COMPACTION_SIZE :]} == {UNUSED}


@pytest.mark.parametrize("dtype", [np.float32, np.uint32, np.uint8])
def test_whole_vector_is_copied(dtype):
    source = np.arange(40).astype(dtype)
    target = np.zeros(40, dtype)
    copy(source, 3, target, 7)
    expected = np.zeros(40, dtype)
    expected[7 : 7 + COMPACTION_SIZE] = source[3 : 3 + COMPACTION_SIZE]
    np.testing.assert_array_equal(target, expected)


def test_first_of_equal_values_is_found_among_those_that_are_compared():
    values = np.arange(BEGIN + COMPACTION_SIZE, dtype=np.uint32)
    values[BEGIN + 4] = values[BEGIN + 7]
    assert find(values, COMPACTION_SIZE, values[-1]) == COMPACTION_SIZE - 1
    assert find(values, 8, values[BEGIN + 7]) == 4
    assert find(values, 8, values[BEGIN + 8]) == COMPACTION_SIZE
    assert find(values, 8, np.uint32(BEGIN - 1)) == COMPACTION_SIZE


@pytest.mark.parametrize("shape", [(40,), (40, 3)])
def test_rows_are_moved_where_source_and_target_overlap(shape):
    array = np.arange(np.prod(shape)).astype(np.float32).reshape(shape)
    expected = array.copy()
    expected[2:32] = array[5:35]
    move(array, 5, 2, 30)
    np.testing.assert_array_equal(array, expected)
