"""Vectors of three numbers as tuples, for kernels.

With arrays of three numbers a kernel takes ten times as long to compile: Numba compiles a function
for every sum and slice of arrays, and counts references to their memory.
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper

__all__ = ["add", "cross", "divide", "dot", "key_point", "norm", "scale", "subtract"]


# Inlined before types are inferred: callers pass row and time as literals, and Numba would compile
# the function again for every literal.
@helper(forceinline=True)
def key_point(points, row, time):  # type: ignore[no-untyped-def]
    """Return the key point of a row at the start (time 0) or end (1) of a tick.

    `points` has shape (rows, 2, 3).
    """
    return points[row, time, 0], points[row, time, 1], points[row, time, 2]


@helper
def add(a, b):  # type: ignore[no-untyped-def]
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@helper
def subtract(a, b):  # type: ignore[no-untyped-def]
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@helper
def scale(factor, a):  # type: ignore[no-untyped-def]
    """Return the product of a number and a vector."""
    return factor * a[0], factor * a[1], factor * a[2]


@helper
def divide(a, divisor):  # type: ignore[no-untyped-def]
    """Return a vector divided by a number."""
    return a[0] / divisor, a[1] / divisor, a[2] / divisor


@helper
def dot(a, b):  # type: ignore[no-untyped-def]
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@helper
def cross(a, b):  # type: ignore[no-untyped-def]
    """Return the vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@helper
def norm(a):  # type: ignore[no-untyped-def]
    """Return the Euclidean norm."""
    return math.sqrt(dot(a, a))
