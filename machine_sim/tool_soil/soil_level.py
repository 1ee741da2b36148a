"""Level of the soil before the opening of a bucket, and the room of the bucket below it.

Soil that a bucket cuts is pushed in by the soil ahead of it, which yields upward where the bucket
is as full as the ground before it is high. From there on the cut heaps up ahead, and the bucket
fills only as far as this berm rises. The surface in the bucket is level: in a bed of spheres
(`benchmarks.resolved_dig`) it is a flat dome, highest before the lip.

The height of the soil ahead is the largest within `_REACH_CELLS` of the lip, in the horizontal
direction in which the bucket opens, mean over the width. Of the heap on the opening only the part
that the opening faces upward counts: before an upright opening it lies on the ground.
"""

from __future__ import annotations

import math

import numpy as np

from machine_sim.ground import surface_at
from msg_bridge.kernels import helper

__all__ = ["room_below_level"]

_REACH_CELLS = 2.5
"""Distance ahead of the lip within which the highest soil counts [cells along the grid]: displaced
soil is put on the first column without a tool."""

_LINES_ACROSS = 3
"""Lines across the width along which the soil ahead is sampled."""

_SAMPLES_AHEAD = 6
"""Samples along each line."""

_MIN_HORIZONTAL = 0.1
"""Horizontal part of the direction of the opening below which it has no direction."""


@helper(allocates=True)
def room_below_level(container, rotation, origin, elevation, frame, struck_m3):  # type: ignore[no-untyped-def]
    """Return the loose volume that goes into a bucket before the soil ahead yields [m^3].

    It is negative if the bucket is fuller than that, 0 if all of it is higher than the soil ahead,
    and infinite if it opens straight up or down.

    Args:
        container: `ContainerTable`; the first point of its profile is the lip.
        rotation, origin: pose of the bucket.
        elevation, frame: of `Ground`.
        struck_m3: loose volume of the soil below the opening [m^3].
    """
    volume = _volume_below_level(container, rotation, origin, elevation, frame)
    if volume == 0.0 or volume == math.inf:
        return volume
    return volume - struck_m3


@helper(allocates=True)
def _volume_below_level(container, rotation, origin, elevation, frame):  # type: ignore[no-untyped-def]
    """Return the volume in and on a bucket below the level of the soil ahead [m^3].

    Args:
        container: `ContainerTable` of the bucket.
        rotation, origin: its pose.
        elevation, frame: of `Ground`.

    Returns:
        The volume; infinite if the opening has no direction.
    """
    profile, width, opening = container.profile, container.width, container.opening
    lip_x, lip_z, out_x, out_z = opening.lip_x, opening.lip_z, opening.out_x, opening.out_z
    # Halfway between out of the opening and toward the lip: horizontal at work in any position.
    ahead_x, ahead_z = out_x - opening.along_x, out_z - opening.along_z
    ax = rotation[0, 0] * ahead_x + rotation[0, 2] * ahead_z
    ay = rotation[1, 0] * ahead_x + rotation[1, 2] * ahead_z
    horizontal = math.hypot(ax, ay)
    if horizontal < _MIN_HORIZONTAL:
        return math.inf
    ax, ay = ax / horizontal, ay / horizontal
    level = 0.0
    for line in range(_LINES_ACROSS):
        side = width * ((line + 0.5) / _LINES_ACROSS - 0.5)
        x = rotation[0, 0] * lip_x + rotation[0, 1] * side + rotation[0, 2] * lip_z + origin[0]
        y = rotation[1, 0] * lip_x + rotation[1, 1] * side + rotation[1, 2] * lip_z + origin[1]
        level += _highest_along(x, y, ax, ay, elevation, frame) / _LINES_ACROSS
    # In the side view: points p with up.p <= level are below it.
    up_x, up_z = rotation[2, 0], rotation[2, 2]
    level -= origin[2]
    struck = _area_below(profile, up_x, up_z, level)
    heap = np.empty((3, 2))  # rim, ridge, lip
    for k in range(3):
        along, height = opening.length * (1.0 - 0.5 * k), opening.heap_height * (k % 2)
        heap[k, 0] = lip_x + along * opening.along_x + height * out_x
        heap[k, 1] = lip_z + along * opening.along_z + height * out_z
    facing_up = max(up_x * out_x + up_z * out_z, 0.0)
    return width * (struck + facing_up * _area_below(heap, up_x, up_z, level))


@helper
def _highest_along(x, y, ax, ay, elevation, frame):  # type: ignore[no-untyped-def]
    """Return the height of the highest soil along a line from (x, y) in direction (ax, ay) [m]."""
    x_first, y_first, per_cell = frame
    step = _REACH_CELLS / (_SAMPLES_AHEAD - 1) * (abs(ax) + abs(ay)) / per_cell
    highest = -math.inf
    for k in range(_SAMPLES_AHEAD):
        height, _, _ = surface_at(
            elevation, x_first, y_first, per_cell, x + k * step * ax, y + k * step * ay
        )
        highest = max(highest, height)
    return highest


@helper
def _area_below(polygon, up_x, up_z, level):  # type: ignore[no-untyped-def]
    """Return the area of a polygon (x, z), counter-clockwise, where up.p <= level [m^2].

    Each edge adds the triangle between its part below the level and a point at the level.
    """
    # A point at the level, so that edges along the level add nothing.
    square = up_x * up_x + up_z * up_z
    if square <= 0.0:
        return 0.0
    base_x, base_z = up_x * level / square, up_z * level / square
    area = 0.0
    for k in range(len(polygon)):
        after = k + 1 if k + 1 < len(polygon) else 0
        ax, az, bx, bz = polygon[k, 0], polygon[k, 1], polygon[after, 0], polygon[after, 1]
        a, b = up_x * ax + up_z * az - level, up_x * bx + up_z * bz - level
        if a > 0.0 and b > 0.0:
            continue
        if a > 0.0 or b > 0.0:
            fraction = a / (a - b)
            cx, cz = ax + fraction * (bx - ax), az + fraction * (bz - az)
            if a > 0.0:
                ax, az = cx, cz
            else:
                bx, bz = cx, cz
        area += 0.5 * ((ax - base_x) * (bz - base_z) - (bx - base_x) * (az - base_z))
    return area
