"""Helpers are compiled without reference counts, and checked for what would need them."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from numba.core.errors import NumbaError

from msg_bridge.kernels import helper, kernel


@helper
def first_of(values: Any) -> Any:
    """Return the first value of an array."""
    return values[0]


@helper
def paired(values: Any) -> Any:
    """Return an array in a tuple."""
    return values, 1.0


@helper(allocates=True)
def doubled(values: Any) -> Any:
    """Return a new array."""
    return 2.0 * values


@helper
def first_doubled(values: Any) -> Any:
    """Call a helper that returns an array."""
    return doubled(values)[0]


@helper
def sum_of_squares(values: Any) -> Any:
    """Make an array."""
    return (values * values).sum()


def test_helpers_leave_the_references_to_an_array_as_they_were() -> None:
    @kernel
    def total(values: Any, count: Any) -> Any:
        sum_of_all = 0.0
        for _ in range(count):
            sum_of_all += first_of(values) + doubled(values)[0]
        return sum_of_all

    values = np.full(3, 2.0)
    total(values, 1)
    before = sys.getrefcount(values)
    assert total(values, 1000) == 6000.0
    assert sys.getrefcount(values) == before


@pytest.mark.parametrize(
    ("function", "named"), [(paired, "paired"), (first_doubled, "first_doubled")]
)
def test_helper_that_would_have_to_count_references_is_rejected(function: Any, named: str) -> None:
    @kernel
    def call(values: Any) -> Any:
        return function(values)

    with pytest.raises(TypeError, match=rf"decorate {named} with helper\(allocates=True\)"):
        call(np.ones(4))


def test_helper_that_makes_an_array_is_rejected() -> None:
    @kernel
    def call(values: Any) -> Any:
        return sum_of_squares(values)

    with pytest.raises(NumbaError, match="NRT required"):
        call(np.ones(4))
