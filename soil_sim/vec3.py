"""Vectors of three numbers as tuples, for kernels.

Tuples, as arrays of three take a kernel ten times as long to compile: every sum and slice of them
is a function of its own to Numba, and their memory is counted.
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper

__all__ = ["add", "cross", "divide", "dot", "key_point", "norm", "scale", "subtract"]


# Taken in where it is called: rows and times are written there as numbers, and Numba compiles a
# function anew for every number it is given so.
@helper(inline="always")
def key_point(points, row, time):  # type: ignore[no-untyped-def]
    """Key point of a row at the start (0) or end (1) of a tick; points of shape (rows, 2, 3)."""
    return points[row, time, 0], points[row, time, 1], points[row, time, 2]


@helper
def add(a, b):  # type: ignore[no-untyped-def]
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@helper
def subtract(a, b):  # type: ignore[no-untyped-def]
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@helper
def scale(factor, a):  # type: ignore[no-untyped-def]
    """A number times a vector."""
    return factor * a[0], factor * a[1], factor * a[2]


@helper
def divide(a, divisor):  # type: ignore[no-untyped-def]
    """A vector by a number."""
    return a[0] / divisor, a[1] / divisor, a[2] / divisor


@helper
def dot(a, b):  # type: ignore[no-untyped-def]
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@helper
def cross(a, b):  # type: ignore[no-untyped-def]
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@helper
def norm(a):  # type: ignore[no-untyped-def]
    """Euclidean."""
    return math.sqrt(dot(a, a))
