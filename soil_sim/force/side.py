"""What resists the side of a tool that moves along its lip: a bucket that is swung in the ground.

The side that leads is a wall from the lowest to the highest of the tool's key points there. It is
cut into upright strips of the tool's length, each a blade square to the ground in the soil that
stands beside it. As for the lip (`soil_sim.force.cutting`) only the width across the travel counts,
so that a tool that drifts a little in its cut feels little of it, and the force is against the
travel; the friction that lifts the soil along the wall is left out.
"""

from __future__ import annotations

import math

from numba import njit

from soil_sim.force.cutting import AHEAD, AT_REST, STRIPS, strip_force
from soil_sim.force.strength import add_force, column_at

__all__ = ["add_side"]

_DRIFT = 0.02
"""Part of its way along its lip below which a tool goes straight."""


@njit(cache=True)
def add_side(points, middle, columns, frame, strength, sums):  # type: ignore[no-untyped-def]
    """Add what resists the leading side of a tool in a tick; places from `middle`.

    Args:
        points: start and end of its key points [m], shape (rows, 2, 3), lip first, left ends first.
        middle: where places count from [m].
        columns, frame: of the terrain.
        strength: of its soils.
        sums: of `add_force`.
    """
    way = 0.5 * (points[0, 1] + points[1, 1] - points[0, 0] - points[1, 0])
    length = math.sqrt((way**2).sum())
    across = points[1, 1] - points[0, 1]
    level = math.hypot(across[0], across[1])
    if length < AT_REST or level < 1e-6:
        return
    t = way / length
    drift = (t * across).sum() / math.sqrt((across**2).sum())
    if abs(drift) < _DRIFT:
        return
    sign = 1.0 if drift > 0.0 else -1.0
    ax, ay = sign * across[0] / level, sign * across[1] / level  # to where it goes, level
    side = points[(1 if drift > 0.0 else 0) :: 2, 1]
    along = side[:, 1] * ax - side[:, 0] * ay
    low, high = along.min(), along.max()
    width = (high - low) / STRIPS
    if width < 1e-6:
        return
    for strip in range(STRIPS):
        x, y, bottom, top = _upright(side, along, low + (strip + 0.5) * width)
        i = column_at(x + AHEAD * frame[2] * ax, y + AHEAD * frame[2] * ay, frame)
        if i < 0 or columns.height[i] <= bottom:
            continue
        below = columns.height[i] - bottom
        depth, wide = min(below, top - bottom), width * abs(drift)
        if depth < 1e-6:
            continue
        against, _ = strip_force(
            i, below, depth, wide, 0.5 * math.pi, top - bottom, columns, strength
        )
        add_force(
            sums, x - middle[0], y - middle[1], bottom + depth / 3.0 - middle[2],
            -against * t[0], -against * t[1], -against * t[2],
        )  # fmt: skip


@njit(cache=True)
def _upright(side, along, at):  # type: ignore[no-untyped-def]
    """Where the outline of a side is lowest at a place along it: x, y, z, and its highest z [m]."""
    x = y = 0.0
    bottom, top = math.inf, -math.inf
    for k in range(len(side)):
        a, b = side[k], side[(k + 1) % len(side)]
        u, v = along[k], along[(k + 1) % len(side)]
        if (u - at) * (v - at) > 0.0 or u == v:
            continue
        part = (at - u) / (v - u)
        z = a[2] + part * (b[2] - a[2])
        if z < bottom:
            x, y, bottom = a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), z
        top = max(top, z)
    return x, y, bottom, top
