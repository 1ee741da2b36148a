"""Kernels of a fixed signature: same results as kernels, and types that are checked in tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from msg_bridge.kernels import fixed_signature_kernel, kernel
from msg_bridge.kernels.fixed_signature import CHECK_VARIABLE


def make_kernel() -> Any:
    """Return a kernel that has not been called."""

    @fixed_signature_kernel
    def add_scaled(values: Any, factor: Any) -> Any:
        for k in range(values.size):
            values[k] *= factor
        return values.sum()

    return add_scaled


@pytest.fixture(params=[False, True], ids=["unchecked", "checked"])
def is_checked(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Set whether calls check the types of their arguments."""
    monkeypatch.setenv(CHECK_VARIABLE, "1" if request.param else "")
    return bool(request.param)


@pytest.mark.usefixtures("is_checked")
def test_every_call_computes_with_its_own_arguments() -> None:
    scale, values = make_kernel(), np.ones(3)
    assert scale(values, 2.0) == 6.0
    assert scale(values, 0.5) == 3.0
    assert scale(np.ones(5), 3.0) == 15.0
    np.testing.assert_array_equal(values, np.ones(3))


def test_arguments_of_another_type_are_an_error_where_types_are_checked(is_checked: bool) -> None:
    scale = make_kernel()
    scale(np.ones(4), 2.0)
    if not is_checked:
        assert scale(np.ones(4), 3) == 12.0  # numbers are converted
        with pytest.raises(TypeError, match="unbox"):
            scale(np.ones(4, np.float32), 2.0)
        return
    for values in (np.ones(4, np.float32), np.ones(8)[::2], np.ones(4, np.int64)):
        with pytest.raises(TypeError, match="add_scaled"):
            scale(values, 2.0)
    assert scale(np.ones(4), 2.0) == 8.0


@pytest.mark.usefixtures("is_checked")
def test_an_array_that_must_not_be_written_to_is_no_other_type() -> None:
    @fixed_signature_kernel
    def total(values: Any) -> Any:
        return values.sum()

    values = np.ones(3)
    assert total(values) == 3.0
    values.flags.writeable = False
    assert total(values) == 3.0


@pytest.mark.usefixtures("is_checked")
def test_other_kernels_call_it() -> None:
    scale = make_kernel()

    @kernel
    def twice(values: Any) -> Any:
        return scale(values, 2.0) + scale(values, 2.0)

    assert twice(np.ones(2)) == 12.0
    assert scale(np.ones(2), 2.0) == 4.0
