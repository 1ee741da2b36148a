"""What resists the side of a tool that moves along its lip: a bucket that is swung in the ground.

The side that leads is a wall from the lowest to the highest of the tool's key points there. It is
cut into upright strips of the tool's length, each a blade square to the ground in the soil that
stands beside it. As for the lip (`soil_sim.tool_force.cutting_edge`) only the width across the travel counts,
so that a tool that drifts a little in its cut feels little of it, and the force is against the
travel; the friction that lifts the soil along the wall is left out.
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper
from soil_sim.tool_force.cutting_edge import (
    LOOKAHEAD_CELLS,
    MIN_TRAVEL,
    NUM_STRIPS,
    blade_strip_force,
)
from soil_sim.tool_force.strength_table import add_force, column_index_at
from soil_sim.vec3 import add, divide, dot, key_point, norm, scale, subtract

__all__ = ["add_side_plate_force"]

_MIN_LATERAL_FRACTION = 0.02
"""Part of its way along its lip below which a tool goes straight."""


@helper(inline="always")
def add_side_plate_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add what resists the leading side of a tool in a tick; places from `middle`.

    Args:
        points: start and end of its key points [m], shape (rows, 2, 3), lip first, left ends first.
        middle: where places count from [m].
        columns, frame: of the terrain.
        strength: of its soils.
        sums: of `add_force`.
    """
    left, right = key_point(points, 0, 1), key_point(points, 1, 1)
    moved = subtract(subtract(add(left, right), key_point(points, 0, 0)), key_point(points, 1, 0))
    way = scale(0.5, moved)
    far = norm(way)
    across = subtract(right, left)
    level = math.hypot(across[0], across[1])
    if far < MIN_TRAVEL or level < 1e-6:
        return
    t = divide(way, far)
    drift = dot(t, across) / norm(across)
    if abs(drift) < _MIN_LATERAL_FRACTION:
        return
    sign = 1.0 if drift > 0.0 else -1.0
    ax, ay = sign * across[0] / level, sign * across[1] / level  # to where it goes, level
    first = 1 if drift > 0.0 else 0  # rows first, first + 2, ... are of the side that leads
    low, high = math.inf, -math.inf
    for row in range(first, len(points), 2):
        along = _position_along_side(points, row, ax, ay)
        low, high = min(low, along), max(high, along)
    width = (high - low) / NUM_STRIPS
    if width < 1e-6:
        return
    for strip in range(NUM_STRIPS):
        x, y, bottom, top = _side_outline_at(points, first, ax, ay, low + (strip + 0.5) * width)
        i = column_index_at(
            x + LOOKAHEAD_CELLS * grid_layout[2] * ax,
            y + LOOKAHEAD_CELLS * grid_layout[2] * ay,
            grid_layout,
        )
        if i < 0 or columns.height[i] <= bottom:
            continue
        below = columns.height[i] - bottom
        depth, wide = min(below, top - bottom), width * abs(drift)
        if depth < 1e-6:
            continue
        against, _ = blade_strip_force(
            i, below, depth, wide, 0.5 * math.pi, top - bottom, columns, strength
        )
        at = x - origin[0], y - origin[1], bottom + depth / 3.0 - origin[2]
        add_force(sums, at, scale(-against, t))


@helper
def _position_along_side(points, row, ax, ay):  # type: ignore[no-untyped-def]
    """Where a key point is at the end of the tick, along a side that goes level to (ax, ay) [m]."""
    return points[row, 1, 1] * ax - points[row, 1, 0] * ay


@helper(inline="always")
def _side_outline_at(points, first, ax, ay, at):  # type: ignore[no-untyped-def]
    """Where the outline of a side is lowest at a place along it: x, y, z, and its highest z [m].

    The side is of the key points `first`, `first` + 2 ... and goes level to (ax, ay).
    """
    x = y = 0.0
    bottom, top = math.inf, -math.inf
    for row in range(first, len(points), 2):
        after = row + 2 if row + 2 < len(points) else first
        u, v = (
            _position_along_side(points, row, ax, ay),
            _position_along_side(points, after, ax, ay),
        )
        if (u - at) * (v - at) > 0.0 or u == v:
            continue
        part = (at - u) / (v - u)
        a, b = key_point(points, row, 1), key_point(points, after, 1)
        z = a[2] + part * (b[2] - a[2])
        if z < bottom:
            x, y, bottom = a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), z
        top = max(top, z)
    return x, y, bottom, top
