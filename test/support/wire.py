"""Messages over the wire, and errors by code."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message

from msg_bridge.contract.errors import ErrorCode, ExchangeError


def over_the_wire(msg: Any) -> Any:
    """Return a message as a subscriber receives it."""
    return deserialize_message(serialize_message(msg), type(msg))


def raises(
    code: ErrorCode, kind: type[ExchangeError] = ExchangeError
) -> AbstractContextManager[pytest.ExceptionInfo[ExchangeError]]:
    """Expect an error of a class and code."""
    return pytest.raises(kind, check=lambda error: error.code is code)


def random_rows(dtype: np.dtype[np.void], count: int, seed: int = 1) -> NDArray[np.void]:
    """Return rows of random bits, NaN and infinity among them, shape (count,)."""
    rng = np.random.default_rng(seed)
    return rng.integers(0, 256, count * dtype.itemsize, dtype=np.uint8).view(dtype)


def with_extra_fields(
    rows: NDArray[np.void], fields: Sequence[tuple[str, str]]
) -> NDArray[np.void]:
    """Return rows with further fields behind their own, as a later version may send them."""
    longer = np.ones(rows.shape, dtype=[*rows.dtype.descr, *fields])
    for name in rows.dtype.names or ():
        longer[name] = rows[name]
    return longer
