"""The surface of the soil ahead of an edge, as a straight line over the failure wedge.

The column under an edge and those beside it are cut already, so the surface is sampled from where
no sample depends on them, and extended from there to the edge. The line has the mean height of the
surface over the wedge, and its height where the wedge ends: so the wedge under it has the weight
and the end of the real one, also where a berm lies before the tool. A plane is reproduced exactly,
for any cell size and direction. Where soil stands higher than the tool, what is above its top is a
surcharge: a blade at the foot of a wall does not push the whole wall.
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper
from soil_sim.tool_force.strength_table import column_index_at

__all__ = ["depth_at", "surface_ahead"]

_NUM_INTERVALS = 4
"""Number of intervals between samples of the surface ahead of a strip."""

_WEDGE_LENGTH = 2.0
"""Length of the failure wedge, from the edge on, in depths: cot(beta) in most soils."""

_CLEARANCE_CELLS = 1.5
"""Distance from an edge, along the grid, at which a bilinear sample uses no column that the edge is
in [cells]."""

_MAX_TANGENT = 1.0
"""Maximum slope of the line, as a tangent: steeper soil is a step, and not a surface to extend."""


@helper
def surface_ahead(x, y, z, direction, height, columns, grid_layout):  # type: ignore[no-untyped-def]
    """Return the soil ahead of a point of an edge: (column, depth, slope, cover).

    Args:
        x, y, z: the point [m].
        direction: horizontal unit vector ahead; zero for the soil above the point.
        height: height of the tool above the point [m].
        columns: `ForceColumns` of the terrain.
        grid_layout: `GridLayout` of the terrain.

    Returns:
        column: flat index of the nearest column ahead that is not cut yet; -1 outside of the map.
        depth: depth of the point below the line [m]; 0 or less above it.
        slope: angle of the line to the horizontal [rad], positive if it rises ahead.
        cover: mean height of the soil above the top of the tool [m].
    """
    ax, ay = direction
    reach = grid_layout.cell * (abs(ax) + abs(ay))
    start = _CLEARANCE_CELLS * reach
    column = column_index_at(x + start * ax, y + start * ay, grid_layout)
    if column < 0:
        return -1, 0.0, 0.0, 0.0
    first = _height_at(x + start * ax, y + start * ay, columns, grid_layout)
    if reach <= 0.0:
        return column, min(first - z, height), 0.0, max(first - z - height, 0.0)
    end = max(_WEDGE_LENGTH * min(max(first - z, 0.0), height), start + reach)
    depth, tangent, cover = _line(
        x, y, z, direction, start, end, reach, math.inf, columns, grid_layout
    )
    if depth > height:
        depth, tangent, cover = _line(
            x, y, z, direction, start, end, reach, z + height, columns, grid_layout
        )
    return column, min(depth, height), math.atan(tangent), cover


@helper
def _line(x, y, z, direction, start, end, reach, top, columns, grid_layout):  # type: ignore[no-untyped-def]
    """Return the line over a wedge: (depth of the edge below it, tangent, cover).

    Args:
        x, y, z: point of the edge [m].
        direction: horizontal unit vector ahead.
        start, end: distances from the edge at which the surface is sampled first and last [m].
        reach: distance ahead over which the surface is extended to the edge [m].
        top: height above which soil is cover [m].
        columns, grid_layout: as for `surface_ahead`.
    """
    ax, ay = direction
    first = _height_at(x + start * ax, y + start * ay, columns, grid_layout)
    beyond = _height_at(x + (start + reach) * ax, y + (start + reach) * ay, columns, grid_layout)
    cover, last = max(first - top, 0.0), min(first, top)
    near_tangent = _limited((min(beyond, top) - last) / reach)
    area = start * (last - 0.5 * start * near_tangent)
    spacing = (end - start) / _NUM_INTERVALS
    for k in range(_NUM_INTERVALS):
        s = start + (k + 1) * spacing
        h = _height_at(x + s * ax, y + s * ay, columns, grid_layout)
        cover += max(h - top, 0.0)
        area += 0.5 * spacing * (last + min(h, top))
        last = min(h, top)
    mean = area / end
    tangent = _limited(2.0 * (last - mean) / end)
    return mean - 0.5 * end * tangent - z, tangent, cover / (_NUM_INTERVALS + 1)


@helper(inline="always")
def _limited(tangent):  # type: ignore[no-untyped-def]
    """Return a slope, limited to that of a surface."""
    return min(max(tangent, -_MAX_TANGENT), _MAX_TANGENT)


@helper
def depth_at(x, y, z, columns, grid_layout):  # type: ignore[no-untyped-def]
    """Return the depth of a point below the surface above it [m]; negative above or off the map."""
    if column_index_at(x, y, grid_layout) < 0:
        return -math.inf
    return _height_at(x, y, columns, grid_layout) - z


@helper
def _height_at(x, y, columns, grid_layout):  # type: ignore[no-untyped-def]
    """Return the height of the surface at a point [m], bilinear between columns.

    Outside of the map it is that of the nearest column.
    """
    rows, cols, cell, x_first, y_first = grid_layout
    u = min(max((x_first - x) / cell, 0.0), rows - 1.0)
    v = min(max((y_first - y) / cell, 0.0), cols - 1.0)
    row, col = min(int(u), rows - 2), min(int(v), cols - 2)
    u -= row
    v -= col
    i = row * cols + col
    height = columns.height
    return (1.0 - u) * ((1.0 - v) * height[i] + v * height[i + 1]) + u * (
        (1.0 - v) * height[i + cols] + v * height[i + cols + 1]
    )
