"""Bearing force on a drum that is not driven.

It removes nothing. The ground bears each of its facets, around it and in strips along it, that
touch the ground, in any direction (`soil_sim.tool_force.bearing_capacity`).
"""

from __future__ import annotations

from msg_bridge.kernels import helper
from soil_sim.tool_force.bearing_capacity import bearing_capacity
from soil_sim.tool_force.strength_table import column_index_at
from soil_sim.tool_force.wrench import add_force
from soil_sim.vec3 import add, divide, key_point, norm, scale, subtract

__all__ = ["add_stationary_drum_force", "is_drum"]

_NUM_STRIPS = 4
"""Number of strips along the drum."""
_PROBE_DISTANCE = 0.01
"""Distance outside of the pick tips at which contact with the ground is tested [m]."""
_MIN_ROWS = 8
"""Minimum number of key points of a drum."""


@helper(forceinline=True)
def is_drum(points):  # type: ignore[no-untyped-def]
    """Return whether key points, shape (rows, 2, 3), form a closed ring, that of a drum."""
    rows = len(points)
    if rows < _MIN_ROWS:
        return False
    for side in range(2):
        for axis in range(3):
            if abs(points[side, 1, axis] - points[rows - 2 + side, 1, axis]) > 1e-6:
                return False
    return True


@helper
def _facet(points, k, axis):  # type: ignore[no-untyped-def]
    """Return facet `k` of a drum, between two pairs of key points, at the end of the tick.

    Returns:
        (midpoint of its left end, midpoint of its right end, unit vector out from `axis`, whether
        the facet is degenerate: on the axis, without a direction).
    """
    left = scale(0.5, add(key_point(points, 2 * k, 1), key_point(points, 2 * k + 2, 1)))
    right = scale(0.5, add(key_point(points, 2 * k + 1, 1), key_point(points, 2 * k + 3, 1)))
    out = subtract(scale(0.5, add(left, right)), axis)
    distance = norm(out)
    is_degenerate = distance < 1e-6
    return left, right, out if is_degenerate else divide(out, distance), is_degenerate


@helper
def _contact_column(at, out, columns, grid_layout):  # type: ignore[no-untyped-def]
    """Return the index of the column that touches a facet at a point from outside, or -1."""
    x, y = at[0] + _PROBE_DISTANCE * out[0], at[1] + _PROBE_DISTANCE * out[1]
    i = column_index_at(x, y, grid_layout)
    if i < 0 or columns.height[i] <= at[2] + _PROBE_DISTANCE * out[2]:
        return -1
    return i


@helper(forceinline=True)
def _drum_center(points, pairs, time):  # type: ignore[no-untyped-def]
    """Return the mean of the key points of a drum [m], at the start (0) or end (1) of the tick."""
    axis = (0.0, 0.0, 0.0)
    for row in range(2 * pairs):
        axis = add(axis, divide(key_point(points, row, time), 2.0 * pairs))
    return axis


@helper(forceinline=True)
def add_stationary_drum_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add the bearing force on a drum at the end of its tick.

    Args:
        points: start and end of the key points [m], shape (rows, 2, 3), around the drum, left
            before right; the last pair coincides with the first.
        origin: origin of the sums in the map frame [m].
        columns: `ForceColumns` of the terrain.
        grid_layout: `GridLayout` of the terrain.
        strength: `strength_table` of its kinds of soil.
        sums: sums of `add_force`.
    """
    pairs = len(points) // 2 - 1
    axis = _drum_center(points, pairs, 1)
    for k in range(pairs):
        left, right, out, is_degenerate = _facet(points, k, axis)
        if is_degenerate:
            continue
        width = subtract(right, left)
        facet_width = norm(subtract(key_point(points, 2 * k + 2, 1), key_point(points, 2 * k, 1)))
        area = facet_width * norm(width) / _NUM_STRIPS
        for strip in range(_NUM_STRIPS):
            at = add(left, scale((strip + 0.5) / _NUM_STRIPS, width))
            i = _contact_column(at, out, columns, grid_layout)
            if i < 0:
                continue
            force = area * bearing_capacity(i, facet_width, 0.0, columns, strength)
            add_force(sums, subtract(at, origin), scale(-force, out))
