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

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine.tools.open_container import OpenContainer
from msg_bridge.kernels import helper, kernel

__all__ = ["room_below_level"]

_REACH_CELLS = 2.5
"""Distance ahead of the lip within which the highest soil counts [cells along the grid]: displaced
soil is put on the first column without a tool."""

_SAMPLES_ACROSS = 3
"""Lines across the width along which the soil ahead is sampled."""

_SAMPLES_AHEAD = 6
"""Samples along each line."""

_MIN_HORIZONTAL = 0.1
"""Horizontal part of the direction of the opening below which it has no direction."""


def room_below_level(shape: OpenContainer, particles: SoilEngine, pose: Pose) -> float:
    """Return the loose volume that goes into a bucket before the soil ahead yields [m^3].

    It is negative if the bucket is fuller than that, 0 if all of it is higher than the soil ahead,
    and infinite if it opens straight up or down.

    Args:
        shape: shape of the bucket; the first point of its profile is the lip.
        particles: the particle engine, with the ground.
        pose: rotation bucket to map, shape (3, 3), and origin [m], shape (3,).
    """
    ground = particles.ground
    room: float = _room_below_level(
        shape.profile,
        shape.width,
        *pose,
        (ground.elevation, ground.frame),
        particles.positions,
        (particles.volumes_mm3, particles.soil, particles.swells),
    )
    return room


@kernel
def _room_below_level(profile, width, rotation, origin, ground, positions, soils):  # type: ignore[no-untyped-def]
    """Return the room of `room_below_level`.

    Args:
        profile, width: of the bucket [m].
        rotation, origin: pose.
        ground: heights [m] and frame of `Ground`.
        positions: of all particles [m], shape (n, 3).
        soils: volume [mm^3] and soil id of each particle, and swell of each soil.
    """
    last = len(profile) - 1
    lip_x, lip_z, rim_x, rim_z = profile[0, 0], profile[0, 1], profile[last, 0], profile[last, 1]
    length = math.hypot(lip_x - rim_x, lip_z - rim_z)
    along_x, along_z = (rim_x - lip_x) / length, (rim_z - lip_z) / length
    out_x, out_z = -along_z, along_x
    # Halfway between out of the opening and toward the lip: horizontal at work in any position.
    ahead_x, ahead_z = out_x - along_x, out_z - along_z
    ax = rotation[0, 0] * ahead_x + rotation[0, 2] * ahead_z
    ay = rotation[1, 0] * ahead_x + rotation[1, 2] * ahead_z
    horizontal = math.hypot(ax, ay)
    if horizontal < _MIN_HORIZONTAL:
        return math.inf
    ax, ay = ax / horizontal, ay / horizontal
    level = 0.0
    for line in range(_SAMPLES_ACROSS):
        side = width * ((line + 0.5) / _SAMPLES_ACROSS - 0.5)
        x = rotation[0, 0] * lip_x + rotation[0, 1] * side + rotation[0, 2] * lip_z + origin[0]
        y = rotation[1, 0] * lip_x + rotation[1, 1] * side + rotation[1, 2] * lip_z + origin[1]
        level += _highest_along(x, y, ax, ay, ground) / _SAMPLES_ACROSS
    # In the side view: points p with up.p <= level are below it.
    up_x, up_z = rotation[2, 0], rotation[2, 2]
    level -= origin[2]
    peak = 0.5 * min(length, width)
    heap = np.array(
        [
            (rim_x, rim_z),
            (0.5 * (lip_x + rim_x) + peak * out_x, 0.5 * (lip_z + rim_z) + peak * out_z),
            (lip_x, lip_z),
        ]
    )
    facing_up = max(up_x * out_x + up_z * out_z, 0.0)
    area = _area_below(profile, up_x, up_z, level)
    if area <= 0.0:
        return 0.0  # in the air: how much is in it does not matter
    area += facing_up * _area_below(heap, up_x, up_z, level)
    return width * area - _loose_volume_inside(profile, width, rotation, origin, positions, soils)


@helper
def _highest_along(x, y, ax, ay, ground):  # type: ignore[no-untyped-def]
    """Return the height of the highest column along a line from (x, y) in direction (ax, ay)."""
    height, (x_first, y_first, per_cell) = ground
    rows, cols = height.shape
    step = _REACH_CELLS / (_SAMPLES_AHEAD - 1) * (abs(ax) + abs(ay)) / per_cell
    highest = -math.inf
    for k in range(_SAMPLES_AHEAD):
        row = int(math.floor((x_first - x - k * step * ax) * per_cell + 0.5))
        col = int(math.floor((y_first - y - k * step * ay) * per_cell + 0.5))
        row, col = min(max(row, 0), rows - 1), min(max(col, 0), cols - 1)
        highest = max(highest, height[row, col])
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


@helper
def _loose_volume_inside(profile, width, rotation, origin, positions, soils):  # type: ignore[no-untyped-def]
    """Return the loose volume of the particles below the opening [m^3]."""
    volumes, soil, swells = soils
    max_square = 0.25 * width * width
    farthest = 0.0
    for k in range(len(profile)):
        farthest = max(farthest, profile[k, 0] ** 2 + profile[k, 1] ** 2)
    max_square += farthest
    volume = 0.0
    for n in range(len(positions)):
        a, b, c = (
            positions[n, 0] - origin[0],
            positions[n, 1] - origin[1],
            positions[n, 2] - origin[2],
        )
        if a * a + b * b + c * c > max_square:
            continue
        y = a * rotation[0, 1] + b * rotation[1, 1] + c * rotation[2, 1]
        if abs(y) > 0.5 * width:
            continue
        x = a * rotation[0, 0] + b * rotation[1, 0] + c * rotation[2, 0]
        z = a * rotation[0, 2] + b * rotation[1, 2] + c * rotation[2, 2]
        is_inside = True
        for k in range(len(profile)):
            after = k + 1 if k + 1 < len(profile) else 0
            px, pz = profile[k, 0], profile[k, 1]
            edge_x, edge_z = profile[after, 0] - px, profile[after, 1] - pz
            is_inside &= edge_x * (z - pz) - edge_z * (x - px) >= 0.0
        if is_inside:
            volume += 1e-9 * volumes[n] * (1.0 + swells[soil[n]])
    return volume
