"""Vector arithmetic for kernels, on vectors of three components as tuples (x, y, z).

All functions are inlined into their callers, so that loops over contacts are still vectorised.
The order of operations within a component is that in which they are written.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.kernels import helper, kernel

__all__ = ["add", "cross", "dot", "load_row", "scale", "store_row", "subtract"]


@kernel(forceinline=True)
def add(a, b):  # type: ignore[no-untyped-def]
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel(forceinline=True)
def subtract(a, b):  # type: ignore[no-untyped-def]
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel(forceinline=True)
def scale(a, factor):  # type: ignore[no-untyped-def]
    """Return a times a scalar."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@kernel(forceinline=True)
def dot(a, b):  # type: ignore[no-untyped-def]
    """Return the scalar product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(forceinline=True)
def cross(a, b):  # type: ignore[no-untyped-def]
    """Return the vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@helper(forceinline=True)
def load_row(array, row, column):  # type: ignore[no-untyped-def]
    """Return the vector in the columns from `column` on of a row of `array`."""
    row = np.uint64(row)  # not negative: saves a test in each access
    return array[row, column], array[row, column + 1], array[row, column + 2]


@helper(forceinline=True)
def store_row(array, row, column, vector):  # type: ignore[no-untyped-def]
    """Write a vector to the columns from `column` on of a row of `array`."""
    row = np.uint64(row)
    array[row, column], array[row, column + 1], array[row, column + 2] = vector
