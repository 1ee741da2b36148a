"""Plane curves that tools are drawn from: smooth profiles, bands and hulls."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["band", "circle", "convex_hull", "smooth_curve", "with_offset"]

Array = NDArray[np.float64]


def smooth_curve(points: ArrayLike, steps: int) -> Array:
    """Return a Catmull-Rom curve through points (n, 2), with `steps` segments between each pair."""
    p = np.asarray(points, dtype=np.float64)
    extended = np.vstack([2.0 * p[0] - p[1], p, 2.0 * p[-1] - p[-2]])
    t = np.arange(steps)[:, None] / steps
    pieces = []
    for a, b, c, d in zip(extended, extended[1:], extended[2:], extended[3:], strict=False):
        pieces.append(
            0.5
            * (
                2.0 * b
                + (c - a) * t
                + (2.0 * a - 5.0 * b + 4.0 * c - d) * t**2
                + (3.0 * b - 3.0 * c + d - a) * t**3
            )
        )
    return np.vstack([*pieces, p[-1:]])


def with_offset(curve: Array, distance: float) -> Array:
    """Return an open curve (n, 2) moved to its right by `distance` [m]."""
    steps = np.diff(curve, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    right = np.column_stack([steps[:, 1], -steps[:, 0]])
    both = np.vstack([right[:1], right[:-1] + right[1:], right[-1:]])
    both *= np.vstack([[[1.0]], 2.0 / np.sum(both[1:-1] ** 2, axis=1, keepdims=True), [[1.0]]])
    moved: Array = curve + distance * both
    return moved


def band(curve: Array, thickness: float) -> Array:
    """Return the outline of a plate on the right of an open curve (n, 2)."""
    return np.vstack([curve, with_offset(curve, thickness)[::-1]])


def circle(center: ArrayLike, radius: float, count: int = 12) -> Array:
    """Return points on a circle, shape (count, 2), counter-clockwise."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.asarray(center) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def convex_hull(points: Array) -> Array:
    """Return the corners of the convex hull of points (n, 2), counter-clockwise."""
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]

    def half(rows: Array) -> list[Array]:
        chain: list[Array] = []
        for point in rows:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 1e-12:
                chain.pop()
            chain.append(point)
        return chain[:-1]

    return np.array([*half(ordered), *half(ordered[::-1])])


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
