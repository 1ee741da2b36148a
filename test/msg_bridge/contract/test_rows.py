"""Copies of rows, and rows that are joined."""

from __future__ import annotations

import numpy as np
import pytest

from msg_bridge.contract.rows import CONVERSION, SWEEP, Rows, copy_rows, empty_rows, join_rows


def numbered(count: int, first: int = 1) -> Rows:
    rows = empty_rows(SWEEP, count)
    rows["seq"] = np.arange(first, first + count)
    return rows


def test_copy_is_writable_and_leaves_the_original_unchanged() -> None:
    rows = numbered(3)
    copied = copy_rows(rows[::2], SWEEP)
    assert copied["seq"].tolist() == [1, 3]
    copied["seq"] = 7
    assert rows["seq"].tolist() == [1, 2, 3]


def test_copy_has_the_dtype_object_that_is_given() -> None:
    of_kernel = numbered(2).view(np.dtype(SWEEP.descr))
    assert of_kernel.dtype is not SWEEP
    assert copy_rows(of_kernel, SWEEP).dtype is SWEEP


def test_joined_rows_are_in_the_order_of_the_parts() -> None:
    joined = join_rows([numbered(2), empty_rows(SWEEP), numbered(3, 5)], SWEEP)
    assert joined["seq"].tolist() == [1, 2, 5, 6, 7]


def test_rows_of_another_dtype_are_not_joined() -> None:
    with pytest.raises(ValueError, match="is required"):
        join_rows([numbered(2), empty_rows(CONVERSION, 1)], SWEEP)
