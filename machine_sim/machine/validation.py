"""Validation of numbers given by a caller."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from machine_sim.machine.errors import MachineError

__all__ = ["finite_numbers"]


def finite_numbers(values: ArrayLike, length: int, name: str) -> list[float]:
    """Return the values as a list of `length` finite floats.

    Raises:
        MachineError: another number of values, or one that is not finite; the message has `name`.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise MachineError(f"{name} {values!r}: give {length} numbers") from None
    numbers: list[float] = array.tolist()
    if array.shape != (length,) or not all(map(math.isfinite, numbers)):
        raise MachineError(f"{name} {values!r}: give {length} finite numbers")
    return numbers
