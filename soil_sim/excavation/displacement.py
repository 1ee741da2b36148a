"""Displacement: soil in the way of a tool that has no room for it is pushed ahead.

A tool takes in only as much soil as it has room for. The rest of what it cuts in a tick leaves its
columns, too, but remains terrain: it becomes loose soil on the first column without a tool in the
direction in which the tool moves there. It heaps up ahead of the edge, where the next tick pushes
it on, and flows to the sides by slope failure: a dozer blade leaves a windrow on both sides, and so
does a full bucket, or one that is swung through the ground. Where the tool moves straight up or
down, and at the edge of the map, the nearest column without a tool gets the soil; if there is none
within `_MAX_DISTANCE`, the soil stays where it was.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.kernels import helper, kernel
from soil_sim.columns.occupancy import FREE
from soil_sim.columns.state import Columns
from soil_sim.excavation.removed_soil import RemovedSoil
from soil_sim.slope_failure.runout import ColumnShares
from soil_sim.tool_sweeps import SweptPairs

__all__ = ["Displacement", "nearest_free_column", "split_by_room"]

_MAX_DISTANCE = 24
"""Maximum distance from a column to that which gets its displaced soil [cells]."""

_MIN_HORIZONTAL_FRACTION = 0.1
"""Horizontal part of the displacement of a tool below which soil is not pushed to one side."""


class Displacement:
    """Finds the columns that displaced soil is pushed to."""

    def __init__(self, columns: Columns, occupied: NDArray[np.uint8]) -> None:
        """
        Args:
            columns: the terrain.
            occupied: marks of `columns.occupancy`, shape (rows, cols).
        """
        self._frame, self._occupied = columns.frame, occupied.reshape(-1)
        self._displaced: list[tuple[RemovedSoil, NDArray[np.float64]]] = []

    def add(self, displaced: RemovedSoil, pairs: SweptPairs) -> None:
        """Add soil that the tool with these pairs has no room for."""
        self._displaced.append((displaced, _directions(displaced, pairs.points)))

    def end_tick(self) -> ColumnShares | None:
        """Return the shares of the columns that get the soil added in the tick; None without any.

        Columns with a tool are marked already.
        """
        if not self._displaced:  # the usual case
            return None
        soil = np.concatenate([soil for soil, _ in self._displaced])
        direction = np.concatenate([direction for _, direction in self._displaced])
        self._displaced = []
        target = _target_columns(soil, direction, self._occupied, self._frame)
        columns = (target, soil["volume_mm3"], soil["soil"], soil["moisture"])
        return ColumnShares(*map(np.ascontiguousarray, columns))


@kernel
def split_by_room(removed, room):  # type: ignore[no-untyped-def]
    """Limit the volume of removed soil to a room [mm^3]; each column has the same fraction.

    Args:
        removed: `REMOVED_SOIL` records of more volume than the room; changed, those of no volume
            are left out.
        room: the room.

    Returns:
        (records of what has room, records of the rest).
    """
    total = np.int64(0)
    for n in range(removed.size):
        total += removed[n].volume_mm3
    rest = removed.copy()
    num_kept = num_rest = 0
    sum_before = kept_before = np.int64(0)
    for n in range(removed.size):
        volume = removed[n].volume_mm3
        sum_before += volume
        # Rounded cumulatively: the sum of what is kept is exactly the room.
        kept = min(np.int64(room * (sum_before / total) + 0.5) - kept_before, volume)
        kept_before += kept
        if volume > kept:
            rest[num_rest] = removed[n]
            rest[num_rest].volume_mm3 = volume - kept
            num_rest += 1
        if kept > 0:
            removed[num_kept] = removed[n]
            removed[num_kept].volume_mm3 = kept
            num_kept += 1
    return removed[:num_kept], rest[:num_rest]


@kernel
def nearest_free_column(cell, occupied, frame):  # type: ignore[no-untyped-def]
    """Return the column without a tool that is nearest to a column.

    It is the column itself if no other is within `_MAX_DISTANCE`.
    """
    if occupied[cell] == FREE:
        return cell
    row, col = cell // frame.cols, cell % frame.cols
    nearest, min_distance2 = cell, np.int64(_MAX_DISTANCE * _MAX_DISTANCE + 1)
    for ring in range(1, _MAX_DISTANCE + 1):
        if ring * ring >= min_distance2:
            break
        for i in range(max(row - ring, 0), min(row + ring, frame.rows - 1) + 1):
            is_end = i in (row - ring, row + ring)
            for j in range(col - ring, col + ring + 1, 1 if is_end else 2 * ring):
                k = i * frame.cols + j
                if not 0 <= j < frame.cols or occupied[k] != FREE:
                    continue
                distance2 = (i - row) * (i - row) + (j - col) * (j - col)
                if distance2 < min_distance2:
                    nearest, min_distance2 = k, distance2
    return nearest


@kernel
def _directions(soil, points):  # type: ignore[no-untyped-def]
    """Return the unit vector in which soil is pushed, that of the nearest key point.

    Args:
        soil: `REMOVED_SOIL` records.
        points: key points as of `SweptPairs`.

    Returns:
        Horizontal unit vectors, shape (records, 2); 0 where the key point moves up or down.
    """
    directions = np.zeros((soil.size, 2))
    for n in range(soil.size):
        min_distance2 = np.inf
        for pair in range(points.shape[0]):
            for end in range(2):
                dx, dy = points[pair, 1, end, 0] - soil[n].x, points[pair, 1, end, 1] - soil[n].y
                dz = points[pair, 1, end, 2] - soil[n].z
                distance2 = dx * dx + dy * dy + dz * dz
                if distance2 >= min_distance2:
                    continue
                min_distance2 = distance2
                mx = points[pair, 1, end, 0] - points[pair, 0, end, 0]
                my = points[pair, 1, end, 1] - points[pair, 0, end, 1]
                mz = points[pair, 1, end, 2] - points[pair, 0, end, 2]
                horizontal = np.hypot(mx, my)
                directions[n] = 0.0
                if horizontal > _MIN_HORIZONTAL_FRACTION * np.hypot(horizontal, mz):
                    directions[n, 0], directions[n, 1] = mx / horizontal, my / horizontal
    return directions


@kernel
def _target_columns(soil, directions, occupied, frame):  # type: ignore[no-untyped-def]
    """Return the column that gets each record of displaced soil, shape (records,), int64."""
    targets = np.empty(soil.size, dtype=np.int64)
    for n in range(soil.size):
        dx, dy = directions[n]
        target = np.int64(-1)
        if dx != 0.0 or dy != 0.0:
            for step in range(1, 2 * _MAX_DISTANCE + 1):
                k = _column_along(soil[n], 0.5 * step * dx, 0.5 * step * dy, frame)
                if k < 0:
                    break
                if occupied[k] == FREE:
                    target = k
                    break
        targets[n] = target if target >= 0 else nearest_free_column(soil[n].cell, occupied, frame)
    return targets


@helper
def _column_along(record, du, dv, frame):  # type: ignore[no-untyped-def]
    """Return the column at a distance (x, y) [cells] from soil, -1 outside of the map."""
    row = np.floor((frame.x_first - record.x) / frame.cell - du + 0.5)
    col = np.floor((frame.y_first - record.y) / frame.cell - dv + 0.5)
    if 0.0 <= row < frame.rows and 0.0 <= col < frame.cols:
        return np.int64(row) * frame.cols + np.int64(col)
    return np.int64(-1)
