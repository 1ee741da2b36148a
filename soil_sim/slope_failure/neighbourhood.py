"""Neighbourhood of a column: the lattice points within a circle (Gauss circle)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["gauss_circle_offsets"]


def gauss_circle_offsets(radius: float) -> NDArray[np.int64]:
    """Return the offsets (row, col) of the lattice points within `radius` cells of the origin.

    The origin is excluded. Shape (n, 2), sorted by distance, then by direction. n is 4, 8, 12, 20,
    24, 28, 36, 44, 48 for r = 1, sqrt 2, 2, sqrt 5, 2 sqrt 2, 3, sqrt 10, sqrt 13, 4 (Table 1 of
    the reference has 42 and 46 for the last two; counting the lattice points gives 44 and 48).
    """
    reach = int(math.floor(radius + 1e-9))
    points = [
        (di, dj)
        for di in range(-reach, reach + 1)
        for dj in range(-reach, reach + 1)
        if 0 < di * di + dj * dj <= radius * radius + 1e-9
    ]
    points.sort(key=lambda p: (p[0] ** 2 + p[1] ** 2, math.atan2(p[1], p[0])))
    return np.array(points, dtype=np.int64)
