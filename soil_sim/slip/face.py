"""Faces: how high undisturbed soil stands where it is steeper than its angle of repose.

A face of slope beta carries itself by the cohesion c of its soil to a height over its toe of

    H = 4 c / gamma * sin(beta) cos(phi) / (1 - cos(beta - phi))

(Culmann's method, Die graphische Statik, 1875, as in Das, Principles of Geotechnical Engineering:
finite slopes that slip on a plane through the toe). For an upright one that is
`SoilType.standing_height`; it has no end where the face is no steeper than phi, the angle of
internal friction. So of two points a level way apart the upper one may be so much higher as a
straight face between them may be high, which is the more the farther they are apart. Firm soil that
is higher than this above any column around it fails, if it is steep there.

Columns that are farther away than soil slips are looked at in eight directions, at ways that grow
by a part, as far as a face of `_GENTLEST` is carried. A grid does not tell where between two
columns a face begins and ends: it counts as shorter by the distance between them, so that one of a
single step is upright.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soil_sim.jit import helper, kernel
from soil_sim.slip.rule import Faces, push
from soil_sim.soils import SoilTables

__all__ = [
    "carried_height",
    "faces_of",
    "firm_that_stands",
    "is_too_high",
    "push_too_high_over",
    "which_are_too_high",
]

Array = NDArray[np.float64]

_GROWTH = 1.15
"""From one way that is looked at to the next."""

_GENTLEST = math.radians(50.0)
"""Slope of the gentlest face that is looked at over more than the radius soil slips in."""

_DIRECTIONS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))

_HALVINGS = 50
"""Of the slopes between which that of a face is looked for: to the last bit."""


def faces_of(
    tables: SoilTables,
    neighbours: NDArray[np.int64],
    shape: tuple[int, int],
    cell: float,
    span: float,
) -> Faces:
    """How much higher than others the columns of a map may be by cohesion.

    Args:
        tables: of its soils.
        neighbours: (row, col) of those that soil slips to [cells], shape (n, 2).
        shape: of the map.
        cell: distance of its columns [m].
        span: from its floor to its highest point [m]: firm soil never stands higher over any other.
    """
    upright = np.where(tables.stands < span, tables.stands, 0.0)  # the others cannot fail
    longest = carried_height(upright, math.inf, tables.friction[:, None], _GENTLEST)
    most = min(longest.max() / math.tan(_GENTLEST) / cell, max(shape))
    ways, way = [], float(np.hypot(*neighbours.T).max())
    while way < most:
        way = max(way * _GROWTH, way + 1.0)
        ways.append(way)
    far = {
        (round(a * way / math.hypot(a, b)), round(b * way / math.hypot(a, b)))
        for way in ways
        for a, b in _DIRECTIONS
    }
    offsets = np.array(sorted(far), dtype=np.int64).reshape(-1, 2)
    return Faces(
        _carried(tables, np.hypot(*neighbours.T), cell),
        offsets,
        _carried(tables, np.hypot(*offsets.T), cell),
    )


def carried_height(
    upright: ArrayLike, way: ArrayLike, friction: ArrayLike, slope: float | None = None
) -> Array:
    """Height [m] to which a face is carried; inf if it ever stands.

    Args:
        upright: height to which an upright one is [m].
        way: level distance from toe to top [m]; without effect if `slope` is given.
        friction: angle of internal friction [rad].
        slope: of the face [rad]; else that is looked for at which it is just carried.
    """
    upright, way, friction = np.broadcast_arrays(*map(np.asarray, (upright, way, friction)))
    if slope is not None:
        return _by_slope(upright, np.full(upright.shape, slope), friction)
    low, high = friction.astype(np.float64), np.full(upright.shape, 0.5 * math.pi)
    for _ in range(_HALVINGS):  # the steeper, the higher for its way, and the less is carried
        slopes = 0.5 * (low + high)
        stands = way * np.tan(slopes) < _by_slope(upright, slopes, friction)
        low, high = np.where(stands, slopes, low), np.where(stands, high, slopes)
    return np.asarray(_by_slope(upright, high, friction))


def _by_slope(upright: Array, slope: Array, friction: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.sin(slope) * (1.0 - np.sin(friction)) / (1.0 - np.cos(slope - friction))
        return np.where(upright <= 0.0, 0.0, np.where(slope <= friction, np.inf, upright * part))


def _carried(tables: SoilTables, distance: Array, cell: float) -> Array:
    """Heights for distances [cells], shape (kinds, MOIST, distances)."""
    ways, index = np.unique(distance, return_inverse=True)
    way = np.maximum(ways - 1.0, 0.0) * cell
    friction = tables.friction[:, None, None]
    return np.ascontiguousarray(carried_height(tables.stands[..., None], way, friction)[..., index])


@helper()
def firm_that_stands(columns, rule, held, i):  # type: ignore[no-untyped-def]
    """Height [m] to which the firm soil of column i stands over all columns around."""
    kind, moisture = columns.soil[i], columns.moisture[i]
    near, far, faces = rule.faces.near, rule.faces.far, rule.faces
    if near[kind, moisture, 0] <= 0.0:  # without cohesion none does
        return columns.floor
    tangent = rule.slope[kind, moisture]
    if rule.steeper.size:
        tangent *= rule.steeper[i]
    row, col = i // rule.cols, i % rule.cols
    stands = columns.floor + columns.firm[i] * columns.metres_per_mm3
    for k in range(rule.offsets.shape[0]):
        r, c = row + rule.offsets[k, 0], col + rule.offsets[k, 1]
        if 0 <= r < rule.rows and 0 <= c < rule.cols:
            j = r * rule.cols + c
            if held[j] == 0:
                carried = max(near[kind, moisture, k], tangent * rule.distance[k])
                stands = min(stands, columns.height[j] + carried)
    for k in range(faces.offsets.shape[0]):
        r, c = row + faces.offsets[k, 0], col + faces.offsets[k, 1]
        if 0 <= r < rule.rows and 0 <= c < rule.cols:
            j = r * rule.cols + c
            if held[j] == 0:
                stands = min(stands, columns.height[j] + far[kind, moisture, k])
    return stands


@helper(inline="always")
def is_too_high(columns, rule, held, i):  # type: ignore[no-untyped-def]
    """Whether some of the firm soil of column i does not stand."""
    base = columns.floor + columns.firm[i] * columns.metres_per_mm3
    return base - firm_that_stands(columns, rule, held, i) > rule.tolerance


@kernel()
def which_are_too_high(columns, rule, held):  # type: ignore[no-untyped-def]
    """Whether some of the firm soil of each column of the map does not stand, flat."""
    found = np.empty(held.size, dtype=np.bool_)
    for i in range(held.size):
        found[i] = is_too_high(columns, rule, held, i)
    return found


@helper()
def push_too_high_over(columns, rule, i, ring):  # type: ignore[no-untyped-def]
    """Push those into the ring that are too high above column i and farther than soil slips."""
    faces = rule.faces
    row, col = i // rule.cols, i % rule.cols
    for k in range(faces.offsets.shape[0]):
        r, c = row - faces.offsets[k, 0], col - faces.offsets[k, 1]
        if 0 <= r < rule.rows and 0 <= c < rule.cols:
            j = r * rule.cols + c
            base = columns.floor + columns.firm[j] * columns.metres_per_mm3
            carried = faces.far[columns.soil[j], columns.moisture[j], k]
            if base - columns.height[i] - rule.tolerance > carried:
                push(j, ring)
