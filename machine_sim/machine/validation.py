"""Numbers that come from outside, checked."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from machine_sim.machine.errors import MachineError

__all__ = ["finite_numbers"]


def finite_numbers(values: ArrayLike, length: int, what: str) -> list[float]:
    """The values as finite floats.

    Raises:
        MachineError: there are more or fewer than `length`, or one is not finite.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise MachineError(f"{what} {values!r}: give {length} numbers") from None
    numbers: list[float] = array.tolist()
    if array.shape != (length,) or not all(map(math.isfinite, numbers)):
        raise MachineError(f"{what} {values!r}: give {length} finite numbers")
    return numbers
