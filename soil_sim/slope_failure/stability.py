"""Faces: how high undisturbed soil stands where it is steeper than its angle of repose.

A face of slope beta carries itself by the cohesion c of its soil to a height over its toe of

    H = 4 c / gamma * sin(beta) cos(phi) / (1 - cos(beta - phi))

(Culmann's method, Die graphische Statik, 1875, as in Das, Principles of Geotechnical Engineering:
finite slopes that slip on a plane through the toe). For an upright one that is
`SoilType.critical_height`; it has no end where the face is no steeper than phi, the angle of
internal friction. So of two points a level way apart the upper one may be so much higher as a
straight face between them may be high, which is the more the farther they are apart. Firm soil that
is higher than this above any column around it fails, if it is steep there.

Columns that are farther away than soil slips are looked at in eight directions, at ways that grow
by a part, as far as a face of `_MIN_FACE_ANGLE` is carried. A grid does not tell where between two
columns a face begins and ends: it counts as shorter by the distance between them, so that one of a
single step is upright.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.slope_failure.relaxation_parameters import StabilityLimits, enqueue
from soil_sim.soils.soil_types import SoilTables

__all__ = [
    "critical_height",
    "enqueue_unstable_above",
    "is_unstable",
    "stability_limits",
    "stable_firm_height",
    "unstable_columns",
]

Array = NDArray[np.float64]

_DISTANCE_RATIO = 1.15
"""From one way that is looked at to the next."""

_MIN_FACE_ANGLE = math.radians(50.0)
"""Slope of the min_repose_tan face that is looked at over more than the radius soil slips in."""

_DIRECTIONS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))

_BISECTION_STEPS = 50
"""Of the slopes between which that of a face is looked for: to the last bit."""


def stability_limits(
    tables: SoilTables,
    neighbours: NDArray[np.int64],
    shape: tuple[int, int],
    cell: float,
    span: float,
) -> StabilityLimits:
    """How much higher than others the columns of a map may be by cohesion.

    Args:
        tables: of its soils.
        neighbours: (row, col) of those that soil slips to [cells], shape (n, 2).
        shape: of the map.
        cell: distance of its columns [m].
        span: from its floor to its highest point [m]: firm soil never stands higher over any other.
    """
    vertical_height = np.where(
        tables.critical_height < span, tables.critical_height, 0.0
    )  # the others cannot fail
    longest = critical_height(
        vertical_height, math.inf, tables.internal_friction[:, None], _MIN_FACE_ANGLE
    )
    most = min(longest.max() / math.tan(_MIN_FACE_ANGLE) / cell, max(shape))
    ways, horizontal_distance = [], float(np.hypot(*neighbours.T).max())
    while horizontal_distance < most:
        horizontal_distance = max(horizontal_distance * _DISTANCE_RATIO, horizontal_distance + 1.0)
        ways.append(horizontal_distance)
    far = {
        (
            round(a * horizontal_distance / math.hypot(a, b)),
            round(b * horizontal_distance / math.hypot(a, b)),
        )
        for horizontal_distance in ways
        for a, b in _DIRECTIONS
    }
    offsets = np.array(sorted(far), dtype=np.int64).reshape(-1, 2)
    return StabilityLimits(
        _critical_heights(tables, np.hypot(*neighbours.T), cell),
        offsets,
        _critical_heights(tables, np.hypot(*offsets.T), cell),
    )


def critical_height(
    vertical_height: ArrayLike,
    horizontal_distance: ArrayLike,
    friction: ArrayLike,
    slope: float | None = None,
) -> Array:
    """Height [m] to which a face is carried; inf if it ever stands.

    Args:
        upright: height to which an upright one is [m].
        way: level distance from toe to top [m]; without effect if `slope` is given.
        friction: angle of internal friction [rad].
        slope: of the face [rad]; else that is looked for at which it is just carried.
    """
    vertical_height, horizontal_distance, friction = np.broadcast_arrays(
        *map(np.asarray, (vertical_height, horizontal_distance, friction))
    )
    if slope is not None:
        return _culmann_height(vertical_height, np.full(vertical_height.shape, slope), friction)
    low, high = friction.astype(np.float64), np.full(vertical_height.shape, 0.5 * math.pi)
    for _ in range(
        _BISECTION_STEPS
    ):  # the steeper, the higher for its way, and the less is carried
        slopes = 0.5 * (low + high)
        critical_height = horizontal_distance * np.tan(slopes) < _culmann_height(
            vertical_height, slopes, friction
        )
        low, high = np.where(critical_height, slopes, low), np.where(critical_height, high, slopes)
    return np.asarray(_culmann_height(vertical_height, high, friction))


def _culmann_height(vertical_height: Array, slope: Array, friction: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.sin(slope) * (1.0 - np.sin(friction)) / (1.0 - np.cos(slope - friction))
        return np.where(
            vertical_height <= 0.0, 0.0, np.where(slope <= friction, np.inf, vertical_height * part)
        )


def _critical_heights(tables: SoilTables, distance: Array, cell: float) -> Array:
    """Heights for distances [cells], shape (kinds, MOISTURE_LEVELS, distances)."""
    ways, index = np.unique(distance, return_inverse=True)
    horizontal_distance = np.maximum(ways - 1.0, 0.0) * cell
    friction = tables.internal_friction[:, None, None]
    return np.ascontiguousarray(
        critical_height(tables.critical_height[..., None], horizontal_distance, friction)[
            ..., index
        ]
    )


@helper
def stable_firm_height(columns, params, occupied, i):  # type: ignore[no-untyped-def]
    """Height [m] to which the firm soil of column i stands over all columns around."""
    kind, moisture = columns.soil[i], columns.moisture[i]
    near, far, stability = (
        params.stability.neighbour_height,
        params.stability.distant_height,
        params.stability,
    )
    if near[kind, moisture, 0] <= 0.0:  # without cohesion none does
        return columns.floor
    tangent = params.repose_tan[kind, moisture]
    if params.repose_tan_scale.size:
        tangent *= params.repose_tan_scale[i]
    row, col = i // params.cols, i % params.cols
    critical_height = columns.floor + columns.firm[i] * columns.metres_per_mm3
    for k in range(params.offsets.shape[0]):
        r, c = row + params.offsets[k, 0], col + params.offsets[k, 1]
        if 0 <= r < params.rows and 0 <= c < params.cols:
            j = r * params.cols + c
            if occupied[j] == 0:
                carried = max(near[kind, moisture, k], tangent * params.distance[k])
                critical_height = min(critical_height, columns.height[j] + carried)
    for k in range(stability.offsets.shape[0]):
        r, c = row + stability.offsets[k, 0], col + stability.offsets[k, 1]
        if 0 <= r < params.rows and 0 <= c < params.cols:
            j = r * params.cols + c
            if occupied[j] == 0:
                critical_height = min(critical_height, columns.height[j] + far[kind, moisture, k])
    return critical_height


@helper(inline="always")
def is_unstable(columns, params, occupied, i):  # type: ignore[no-untyped-def]
    """Whether some of the firm soil of column i does not stand."""
    base = columns.floor + columns.firm[i] * columns.metres_per_mm3
    return base - stable_firm_height(columns, params, occupied, i) > params.tolerance


@kernel
def unstable_columns(columns, params, occupied):  # type: ignore[no-untyped-def]
    """Whether some of the firm soil of each column of the map does not stand, flat."""
    found = np.empty(occupied.size, dtype=np.bool_)
    for i in range(occupied.size):
        found[i] = is_unstable(columns, params, occupied, i)
    return found


@helper
def enqueue_unstable_above(columns, params, i, cell_queue):  # type: ignore[no-untyped-def]
    """Push those into the ring that are too high above column i and farther than soil slips."""
    stability = params.stability
    row, col = i // params.cols, i % params.cols
    for k in range(stability.offsets.shape[0]):
        r, c = row - stability.offsets[k, 0], col - stability.offsets[k, 1]
        if 0 <= r < params.rows and 0 <= c < params.cols:
            j = r * params.cols + c
            base = columns.floor + columns.firm[j] * columns.metres_per_mm3
            carried = stability.distant_height[columns.soil[j], columns.moisture[j], k]
            if base - columns.height[i] - params.tolerance > carried:
                enqueue(j, cell_queue)
