"""Stability of firm soil: the height to which a face steeper than the angle of repose stands.

A face with a slope beta is supported by the cohesion c of its soil up to a height above its toe of

    H = 4 c / gamma * sin(beta) cos(phi) / (1 - cos(beta - phi))

(Culmann's method, Die graphische Statik, 1875, as in Das, Principles of Geotechnical Engineering:
finite slopes that fail along a plane through the toe). For a vertical face this is
`SoilType.critical_height`; it is infinite where the face is no steeper than phi, the angle of
internal friction. Of two points at a horizontal distance, the upper one may therefore be higher by
the critical height of a straight face between them, which increases with the distance. Firm soil
that is higher than this above any column around it fails, if it is steeper than its angle of repose
there: see `soil_sim.slope_failure.wedge_failure`.

Columns beyond the neighbourhood that soil slides in are checked in 16 directions, at distances
that increase geometrically, up to the distance at which a face of `_MIN_FACE_ANGLE` is stable. A
grid does not resolve where between two columns a face begins and ends: a face of a single step is
vertical, and that of a long slope is shorter than the distance of its columns by half a cell in the
mean (`face_length`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.occupancy import TOOL_INSIDE
from soil_sim.columns.operations import firm_top
from soil_sim.slope_failure.cell_queue import enqueue
from soil_sim.slope_failure.neighbourhood import is_tool_between
from soil_sim.soils.soil_types import SoilTables

__all__ = [
    "StabilityLimits",
    "critical_height",
    "enqueue_unstable_above",
    "face_length",
    "find_toe",
    "stability_limits",
    "unstable_columns",
]

Array = NDArray[np.float64]

_DISTANCE_RATIO = 1.08
"""Ratio of successive distances at which distant columns are checked; at least one cell apart."""

_MIN_FACE_ANGLE = math.radians(38.0)
"""Minimum slope of a face that is checked beyond the neighbourhood that soil slides in [rad]."""

_DIRECTIONS = tuple(
    (math.cos(angle), math.sin(angle)) for angle in np.linspace(0.0, 2.0 * math.pi, 17)[:-1]
)
"""Directions (row, col) in which distant columns are checked."""

_BISECTION_STEPS = 50
"""Bisection steps for the slope of a face: down to the last bit."""


class StabilityLimits(NamedTuple):
    """How much higher than other columns a column of firm soil stands by its cohesion.

    Attributes:
        neighbour_height: limit over each neighbour [m], shape (kinds, MOISTURE_LEVELS, neighbours),
            float64.
        distant_offsets: (row, col) of the columns beyond the neighbourhood [cells], shape (m, 2),
            int64; empty if no soil has cohesion.
        distant_height: limit over each of those [m], shape (kinds, MOISTURE_LEVELS, m), float64.
        friction: angle of internal friction of each kind [rad], shape (kinds,), float64.
        has_cohesion: whether any soil has cohesion at any moisture.
    """

    neighbour_height: NDArray[np.float64]
    distant_offsets: NDArray[np.int64]
    distant_height: NDArray[np.float64]
    friction: NDArray[np.float64]
    has_cohesion: bool


def stability_limits(
    tables: SoilTables,
    neighbours: NDArray[np.int64],
    shape: tuple[int, int],
    cell: float,
    span: float,
) -> StabilityLimits:
    """Return the limits for a map.

    Args:
        tables: properties of its kinds of soil.
        neighbours: (row, col) of the neighbours that soil slides to [cells], shape (n, 2).
        shape: size of the map [cells].
        cell: distance between columns [m].
        span: height of the highest point above the floor [m]; no face is higher.
    """
    # Soil whose vertical face of the full span is stable cannot fail.
    vertical_height = np.where(tables.critical_height < span, tables.critical_height, 0.0)
    face_height = critical_height(
        vertical_height, math.inf, tables.internal_friction[:, None], _MIN_FACE_ANGLE
    )
    max_height = min(float(face_height.max()), span)
    max_distance = min(max_height / math.tan(_MIN_FACE_ANGLE) / cell, max(shape))
    distances, distance = [], float(np.hypot(*neighbours.T).max())
    while distance < max_distance:
        distance = max(distance * _DISTANCE_RATIO, distance + 1.0)
        distances.append(distance)
    points = {
        (round(a * distance), round(b * distance)) for distance in distances for a, b in _DIRECTIONS
    }
    offsets = np.array(sorted(points), dtype=np.int64).reshape(-1, 2)
    neighbour_height = _critical_heights(tables, np.hypot(*neighbours.T), cell)
    return StabilityLimits(
        neighbour_height,
        offsets,
        _critical_heights(tables, np.hypot(*offsets.T), cell),
        np.asarray(tables.internal_friction, dtype=np.float64),
        has_cohesion=bool((neighbour_height > 0.0).any()),
    )


def critical_height(
    vertical_height: ArrayLike,
    horizontal_distance: ArrayLike,
    friction: ArrayLike,
    slope: float | None = None,
) -> Array:
    """Return the height [m] to which a face is stable; inf if it is stable at any height.

    Args:
        vertical_height: critical height of a vertical face [m].
        horizontal_distance: distance from toe to top [m]; ignored if `slope` is given.
        friction: angle of internal friction [rad].
        slope: slope of the face [rad]; if not given, the slope at which a face over the distance
            has exactly its critical height.
    """
    vertical_height, horizontal_distance, friction = np.broadcast_arrays(
        *map(np.asarray, (vertical_height, horizontal_distance, friction))
    )
    if slope is not None:
        return _culmann_height(vertical_height, np.full(vertical_height.shape, slope), friction)
    low, high = friction.astype(np.float64), np.full(vertical_height.shape, 0.5 * math.pi)
    # A steeper face over the same distance is higher, and its critical height is smaller.
    for _ in range(_BISECTION_STEPS):
        slopes = 0.5 * (low + high)
        is_stable = horizontal_distance * np.tan(slopes) < _culmann_height(
            vertical_height, slopes, friction
        )
        low, high = np.where(is_stable, slopes, low), np.where(is_stable, high, slopes)
    return np.asarray(_culmann_height(vertical_height, high, friction))


def _culmann_height(vertical_height: Array, slope: Array, friction: Array) -> Array:
    """Return the critical height [m] of faces by their slope [rad]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sin(slope) * (1.0 - np.sin(friction)) / (1.0 - np.cos(slope - friction))
        return np.where(
            vertical_height <= 0.0,
            0.0,
            np.where(slope <= friction, np.inf, vertical_height * ratio),
        )


def _critical_heights(tables: SoilTables, distance: Array, cell: float) -> Array:
    """Return critical heights [m] over distances [cells].

    Returns:
        Shape (kinds, MOISTURE_LEVELS, distances).
    """
    distances, index = np.unique(distance, return_inverse=True)
    horizontal_distance = np.array([face_length(each) for each in distances]) * cell
    friction = tables.internal_friction[:, None, None]
    heights = critical_height(tables.critical_height[..., None], horizontal_distance, friction)
    return np.ascontiguousarray(heights[..., index])


@kernel
def face_length(distance):  # type: ignore[no-untyped-def]
    """Return the horizontal length of a face between two columns [cells], at least 0.

    Args:
        distance: distance of the columns [cells].
    """
    return max(distance - 0.5 - 0.5 / max(distance, 1.0), 0.0)


@helper
def find_toe(columns, params, occupied, i):  # type: ignore[no-untyped-def]
    """Return the toe of the face below column i, and the height to which its firm soil is stable.

    The toe is the column above which column i may be lowest. Its flat index is -1, and the height
    infinite, if the soil has no cohesion.
    """
    kind, moisture = columns.soil[i], columns.moisture[i]
    stability = params.stability
    near, far = stability.neighbour_height, stability.distant_height
    toe, height = np.int64(-1), math.inf
    if near[kind, moisture, 0] <= 0.0:
        return toe, height
    tangent = params.repose_tan[kind, moisture]
    if params.repose_tan_scale.size:
        tangent *= params.repose_tan_scale[i]
    row, col = i // params.cols, i % params.cols
    for k in range(params.offsets.shape[0]):
        r, c = row + params.offsets[k, 0], col + params.offsets[k, 1]
        if 0 <= r < params.rows and 0 <= c < params.cols:
            j = r * params.cols + c
            limit = columns.height[j] + max(near[kind, moisture, k], tangent * params.distance[k])
            if (
                limit < height
                and occupied[j] != TOOL_INSIDE
                and not is_tool_between(occupied, params.between, i, k)
            ):
                toe, height = j, limit
    for k in range(stability.distant_offsets.shape[0]):
        r, c = row + stability.distant_offsets[k, 0], col + stability.distant_offsets[k, 1]
        if 0 <= r < params.rows and 0 <= c < params.cols:
            j = r * params.cols + c
            limit = columns.height[j] + far[kind, moisture, k]
            is_free = occupied[j] != TOOL_INSIDE
            if limit < height and is_free and not _is_supported(occupied, params, i, k):
                toe, height = j, limit
    return toe, height


@helper
def _is_supported(occupied, params, i, k):  # type: ignore[no-untyped-def]
    """Return whether a tool supports column i against the distant column k."""
    dr, dc = params.stability.distant_offsets[k]
    steps = max(abs(dr), abs(dc))
    for n in range(1, steps):
        row, col = round(n * dr / steps), round(n * dc / steps)
        if occupied[i + row * params.cols + col] == TOOL_INSIDE:
            return True
    return False


@kernel
def unstable_columns(columns, params, occupied):  # type: ignore[no-untyped-def]
    """Return whether each column of the map has unstable firm soil, flat, bool.

    Soil without cohesion always is: it stands at its angle of repose only.
    """
    unstable = np.empty(occupied.size, dtype=np.bool_)
    for i in range(occupied.size):
        toe, stable_height = find_toe(columns, params, occupied, i)
        unstable[i] = toe < 0 or firm_top(columns, i) - stable_height > params.tolerance
    return unstable


@helper
def enqueue_unstable_above(columns, params, i, queue):  # type: ignore[no-untyped-def]
    """Enqueue columns beyond the neighbourhood whose firm soil is too high above column i."""
    stability = params.stability
    row, col = i // params.cols, i % params.cols
    for k in range(stability.distant_offsets.shape[0]):
        r, c = row - stability.distant_offsets[k, 0], col - stability.distant_offsets[k, 1]
        if 0 <= r < params.rows and 0 <= c < params.cols:
            j = r * params.cols + c
            limit = stability.distant_height[columns.soil[j], columns.moisture[j], k]
            if firm_top(columns, j) - columns.height[i] - params.tolerance > limit:
                enqueue(queue, j)
