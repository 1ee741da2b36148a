"""The surface of the soil ahead of an edge, as a straight line over the failure wedge.

The column under an edge and those beside it are cut already, so the surface is sampled from where
no sample depends on them, and extended from there to the edge: firm soil with its slope, and loose
soil on it with its depth, because a berm that a tool pushes is level where it meets the tool. The
line has the mean height of the surface over the wedge, and its height where the wedge ends: so the
wedge under it has the weight and the end of the real one, also where a berm lies before the tool. A
plane is reproduced exactly, for any cell size and direction. Where soil stands higher than the
tool, what is above its top is a surcharge: a blade at the foot of a wall does not push all of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from msg_bridge.kernels import helper
from soil_sim.tool_force.strength_table import column_index_at, loose_cover

__all__ = ["NUM_SAMPLES", "SurfaceAhead", "area_to_face", "depth_at", "surface_ahead"]

NUM_SAMPLES = 7
"""Number of samples of the surface ahead of a strip."""

_WEDGE_LENGTH = 2.0
"""Length of the failure wedge, from the edge on, in depths: cot(beta) in most soils."""

_CLEARANCE_CELLS = 1.5
"""Distance from an edge, along the grid, at which a bilinear sample uses no column that the edge is
in [cells]."""

_MIN_SINE = 0.05
"""Minimum sine of the angle between a face and the surface."""

_MAX_TANGENT = 1.0
"""Maximum slope of the line, as a tangent: steeper soil is a step, and not a surface to extend."""


class SurfaceAhead(NamedTuple):
    """The soil ahead of a point of an edge.

    Attributes:
        column: flat index of the nearest column ahead that is not cut yet; -1 outside of the map.
        depth: depth of the point below the line, at most the height of the tool [m]; 0 or less
            above it.
        slope: angle of the line to the horizontal [rad], positive if it rises ahead.
        cover: mean height of the soil above the top of the tool [m].
        line_depth: depth of the point below the line [m].
        start, spacing: distance of the first sample from the point, and between samples [m]; a
            spacing of 0 without samples.
        at_edge: height of the surface, extended to the point, above it [m].
        near_tangent: slope with which it is extended.
    """

    column: int
    depth: float
    slope: float
    cover: float
    line_depth: float
    start: float
    spacing: float
    at_edge: float
    near_tangent: float


@helper
def surface_ahead(x, y, z, direction, height, columns, grid_layout, samples):  # type: ignore[no-untyped-def]
    """Return the soil ahead of a point of an edge, as `SurfaceAhead`.

    Args:
        x, y, z: the point [m].
        direction: horizontal unit vector ahead; zero for the soil above the point.
        height: height of the tool above the point [m].
        columns: `ForceColumns` of the terrain.
        grid_layout: `GridLayout` of the terrain.
        samples: out, heights of the surface above the point, up to the top of the tool [m], at
            equal distances, shape (`NUM_SAMPLES`,).
    """
    ax, ay = direction
    reach = grid_layout.cell * (abs(ax) + abs(ay))
    start = _CLEARANCE_CELLS * reach
    column = column_index_at(x + start * ax, y + start * ay, grid_layout)
    if column < 0:
        return SurfaceAhead(-1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    first = _height_at(x + start * ax, y + start * ay, columns, grid_layout)
    if reach <= 0.0:
        depth, cover = min(first - z, height), max(first - z - height, 0.0)
        return SurfaceAhead(column, depth, 0.0, cover, depth, 0.0, 0.0, depth, 0.0)
    end = max(_WEDGE_LENGTH * min(max(first - z, 0.0), height), start + reach)
    spacing = (end - start) / (NUM_SAMPLES - 1)
    for k in range(NUM_SAMPLES):
        s = start + k * spacing
        samples[k] = _height_at(x + s * ax, y + s * ay, columns, grid_layout) - z
    near_tangent = _limited(
        (
            _firm_height_at(
                x + (start + reach) * ax, y + (start + reach) * ay, columns, grid_layout
            )
            - _firm_height_at(x + start * ax, y + start * ay, columns, grid_layout)
        )
        / reach
    )
    depth, tangent = _line(samples, start, spacing, near_tangent)
    cover = 0.0
    if depth > height:
        if samples[0] > height:
            near_tangent = 0.0
        for k in range(NUM_SAMPLES):
            cover += max(samples[k] - height, 0.0)
            samples[k] = min(samples[k], height)
        depth, tangent = _line(samples, start, spacing, near_tangent)
    at_edge = samples[0] - start * near_tangent
    return SurfaceAhead(
        column, min(depth, height), math.atan(tangent), cover / NUM_SAMPLES, depth, start, spacing,
        at_edge, near_tangent,
    )  # fmt: skip


@helper
def _line(samples, start, spacing, near_tangent):  # type: ignore[no-untyped-def]
    """Return the line over a wedge: (depth of the edge below it [m], tangent).

    Args:
        samples: heights of the surface above the edge [m].
        start, spacing: distances of the samples [m].
        near_tangent: slope with which the surface is extended to the edge.
    """
    area = start * (samples[0] - 0.5 * start * near_tangent)
    for k in range(1, NUM_SAMPLES):
        area += 0.5 * spacing * (samples[k - 1] + samples[k])
    end = start + (NUM_SAMPLES - 1) * spacing
    mean = area / end
    tangent = _limited(2.0 * (samples[NUM_SAMPLES - 1] - mean) / end)
    return mean - 0.5 * end * tangent, tangent


@helper(forceinline=True)
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
    i, u, v = _position_between_columns(x, y, grid_layout)
    cols, height = grid_layout.cols, columns.height
    return (1.0 - u) * ((1.0 - v) * height[i] + v * height[i + 1]) + u * (
        (1.0 - v) * height[i + cols] + v * height[i + cols + 1]
    )


@helper
def _firm_height_at(x, y, columns, grid_layout):  # type: ignore[no-untyped-def]
    """Return the height of the firm soil at a point [m], as `_height_at`."""
    i, u, v = _position_between_columns(x, y, grid_layout)
    total = 0.0
    for k in range(4):
        column = i + (grid_layout.cols if k >= 2 else 0) + k % 2
        weight = (u if k >= 2 else 1.0 - u) * (v if k % 2 else 1.0 - v)
        total += weight * (columns.height[column] - loose_cover(columns, column))
    return total


@helper(forceinline=True)
def _position_between_columns(x, y, grid_layout):  # type: ignore[no-untyped-def]
    """Return the flat index of the first of the four columns around a point, and fractions.

    The fractions are those of the way to the next row and to the next column, 0 to 1.
    """
    rows, cols, cell, x_first, y_first = grid_layout
    u = min(max((x_first - x) / cell, 0.0), rows - 1.0)
    v = min(max((y_first - y) / cell, 0.0), cols - 1.0)
    row, col = min(int(u), rows - 2), min(int(v), cols - 2)
    return row * cols + col, u - row, v - col


@helper(forceinline=True)
def area_to_face(height, tangent, face):  # type: ignore[no-untyped-def]
    """Return the area behind an edge, between the face and a surface that is extended [m^2].

    Args:
        height: of the surface above the edge [m].
        tangent: slope with which it rises ahead.
        face: angle of the face to the horizontal [rad].
    """
    cos = math.cos(face)
    return 0.5 * height * height * cos / max(math.sin(face) + cos * tangent, _MIN_SINE)
