"""A boxed table gives kernels the arrays that it was made from."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import box_table, kernel


class Inner(NamedTuple):
    """A table within a table."""

    offset: NDArray[np.float64]
    factor: float


class Outer(NamedTuple):
    """A table of an array and another table."""

    values: NDArray[np.float64]
    inner: Inner


@kernel
def scale_values(boxed: Any) -> Any:
    """Scale the values in place, and return their sum."""
    table = boxed.table
    values, inner = table.values, table.inner
    for k in range(values.size):
        values[k] = values[k] * inner.factor + inner.offset[k]
    return values.sum()


def test_kernel_reads_and_writes_the_arrays_of_a_boxed_table() -> None:
    values, offset = np.arange(3.0), np.ones(3)
    boxed = box_table(Outer(values, Inner(offset, 2.0)))
    assert scale_values(boxed) == 9.0
    np.testing.assert_array_equal(values, [1.0, 3.0, 5.0])
    offset[:] = 0.0
    assert scale_values(boxed) == 18.0


def test_boxed_table_keeps_its_arrays_alive() -> None:
    boxed = box_table(Outer(np.full(1000, 3.0), Inner(np.zeros(1000), 1.0)))
    others = [np.full(1000, 7.0) for _ in range(100)]  # would take freed memory
    assert scale_values(boxed) == 3000.0
    assert len(others) == 100
