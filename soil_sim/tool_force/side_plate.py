"""Resistance to the side of a tool that moves along its cutting edge, as a bucket that is swung.

The leading side is a wall between the lowest and the highest key point on that side. It is divided
into upright strips along the tool, each a vertical blade in the soil beside it. As for the cutting
edge (`cutting_edge`), only the width across the travel counts, so a small sideways drift in a cut
has a small resistance, and the force is against the travel. The friction that lifts the soil along
the wall is neglected.
"""

from __future__ import annotations

import math

import numpy as np

from msg_bridge.kernels import helper
from soil_sim.tool_force.cutting_edge import MIN_TRAVEL, NUM_STRIPS, blade_strip_force
from soil_sim.tool_force.surface_ahead import NUM_SAMPLES, surface_ahead
from soil_sim.tool_force.wrench import add_force
from soil_sim.vec3 import add, divide, dot, key_point, norm, scale, subtract

__all__ = ["add_side_plate_force"]

_MIN_LATERAL_FRACTION = 0.02
"""Minimum sideways part of the travel; below it a side has no resistance."""


@helper(allocates=True, forceinline=True)
def add_side_plate_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add the resistance to the leading side of a tool in a tick.

    Args:
        points: start and end of the key points [m], shape (rows, 2, 3), cutting edge first, left
            before right.
        origin: origin of the sums in the map frame [m].
        columns: `ForceColumns` of the terrain.
        grid_layout: `GridLayout` of the terrain.
        strength: `strength_table` of its kinds of soil.
        sums: sums of `add_force`.
    """
    left, right = key_point(points, 0, 1), key_point(points, 1, 1)
    moved = subtract(subtract(add(left, right), key_point(points, 0, 0)), key_point(points, 1, 0))
    displacement = scale(0.5, moved)
    distance = norm(displacement)
    across = subtract(right, left)
    horizontal = math.hypot(across[0], across[1])
    if distance < MIN_TRAVEL or horizontal < 1e-6:
        return
    t = divide(displacement, distance)
    lateral_fraction = dot(t, across) / norm(across)
    if abs(lateral_fraction) < _MIN_LATERAL_FRACTION:
        return
    # (ax, ay) is the horizontal unit vector out of the leading side.
    sign = 1.0 if lateral_fraction > 0.0 else -1.0
    ax, ay = sign * across[0] / horizontal, sign * across[1] / horizontal
    first = 1 if lateral_fraction > 0.0 else 0  # the leading side has rows first, first + 2, ...
    low, high = math.inf, -math.inf
    for row in range(first, len(points), 2):
        along = _position_along_side(points, row, ax, ay)
        low, high = min(low, along), max(high, along)
    width = (high - low) / NUM_STRIPS
    if width < 1e-6:
        return
    samples = np.empty(NUM_SAMPLES)
    for strip in range(NUM_STRIPS):
        x, y, bottom, top = _side_outline_at(points, first, ax, ay, low + (strip + 0.5) * width)
        surface = surface_ahead(x, y, bottom, (ax, ay), top - bottom, columns, grid_layout, samples)
        depth = surface.depth
        if surface.column < 0 or depth < 1e-6:
            continue
        cutting, _, _ = blade_strip_force(
            surface, samples, top - bottom, depth, width * abs(lateral_fraction), (0.0, 0.0),
            0.5 * math.pi, 0.0, columns, strength,
        )  # fmt: skip
        at = x - origin[0], y - origin[1], bottom + depth / 3.0 - origin[2]
        add_force(sums, at, scale(-cutting, t))


@helper
def _position_along_side(points, row, ax, ay):  # type: ignore[no-untyped-def]
    """Return the position of a key point along a side at the end of the tick [m].

    (ax, ay) is the horizontal unit vector out of the side.
    """
    return points[row, 1, 1] * ax - points[row, 1, 0] * ay


@helper(forceinline=True)
def _side_outline_at(points, first, ax, ay, at):  # type: ignore[no-untyped-def]
    """Return the lowest point (x, y, z) of the outline of a side, and its highest z [m].

    Args:
        points: key points of the tool [m], shape (rows, 2, 3).
        first: first row of the side; its rows are `first`, `first` + 2, ...
        ax, ay: horizontal unit vector out of the side.
        at: position along the side [m], as of `_position_along_side`.
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
        fraction = (at - u) / (v - u)
        a, b = key_point(points, row, 1), key_point(points, after, 1)
        z = a[2] + fraction * (b[2] - a[2])
        if z < bottom:
            x, y = a[0] + fraction * (b[0] - a[0]), a[1] + fraction * (b[1] - a[1])
            bottom = z
        top = max(top, z)
    return x, y, bottom, top
