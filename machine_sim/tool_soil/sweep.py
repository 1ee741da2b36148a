"""SWEEP rows: the motion of the key points of tools and tracks in a tick, and their action.

Each row is one key point with its start and end in the tick; two consecutive rows are a pair, the
left and the right end of a strip. The action is to cut, to mill or to compact:

- A plate with a cutting edge compacts where it moves along its outward normal, and else cuts.
- A drum mills while it is driven, and else compacts.
- Tracks compact the ground under their shoes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose
from machine_sim.machine.box import Vec3
from machine_sim.machine.rotated_vectors import rotate_to_frame, rotate_to_map
from machine_sim.machine.tracks.track_model import ShoeTable, Tracks, sole_contact
from msg_bridge.contract.rows import (
    MAX_MILLING_WORK,
    SWEEP,
    SWEEP_SEGMENT,
    UNLIMITED_ROOM,
    Rows,
    SweepAction,
    copy_rows,
    empty_rows,
    no_rows,
)
from msg_bridge.kernels import box_table, fixed_signature_kernel, helper

__all__ = ["DrumSweep", "PlateSweep", "TrackSweep"]

_MIN_COMPACTING_COSINE = 0.7
"""Minimum cosine between a plate's displacement and its outward normal at which it compacts."""

_MIN_POINT_DISPLACEMENT = 1e-5
"""Displacement of a key point in a tick [m] below which its direction means nothing: it cuts."""

_MIN_TRACK_DISPLACEMENT = 2e-4
"""Displacement of all track points in a tick [m] below which the machine stands."""

_CUT, _COMPACT, _MILL = map(int, (SweepAction.CUT, SweepAction.COMPACT, SweepAction.MILL))


class _KeyPointStrip:
    """Rows of a strip of key points, in which only segments and actions change.

    Attributes:
        rows: SWEEP rows, overwritten each tick, shape (points,).
        segments: x0, y0, z0, x1, y1, z1 of the rows [m], a view, shape (points, 6), float32.
        displacements: from start to end [m], not rounded, shape (points, 3), float64.
    """

    def __init__(self, num_points: int, tool_id: int) -> None:
        """
        Args:
            num_points: number of key points, two per pair.
            tool_id: id of the tool.
        """
        self.rows = empty_rows(SWEEP, num_points)
        self.rows["pair"] = np.arange(num_points) // 2
        self.rows["tool"], self.rows["room_mm3"] = tool_id, UNLIMITED_ROOM
        self.segments: NDArray[np.float32] = self.rows.view(SWEEP_SEGMENT)["ends"]
        self.displacements: NDArray[np.float64] = np.zeros((num_points, 3))

    def copy(self) -> Rows:
        """Return a copy of the rows, which the next tick does not overwrite."""
        return copy_rows(self.rows, SWEEP)

    def move(self, points: NDArray[np.float64], start: Pose, end: Pose) -> float:
        """Move points of a tool frame from one pose to another.

        Args:
            points: [m], shape (points, 3).
            start, end: poses of the frame.

        Returns:
            Maximum component of a displacement [m].
        """
        displacement: float = _move_points(points, *start, *end, self.segments, self.displacements)
        return displacement


class PlateSweep:
    """Sweep of a tool with a cutting edge: it cuts, and compacts with the back of its plates."""

    def __init__(
        self, key_points: NDArray[np.float64], outward_normals: NDArray[np.float64], tool_id: int
    ) -> None:
        """
        Args:
            key_points: [m], tool frame, shape (2 * pairs, 3), edge first, left before right.
            outward_normals: unit normals of the back of the plates, shape (pairs, 3).
            tool_id: id of the tool.
        """
        self._points, self._normals = key_points, outward_normals
        self._key_points = _KeyPointStrip(len(self._points), tool_id)
        self._action: NDArray[np.uint8] = self._key_points.rows["action"]
        self._room: NDArray[np.uint32] = self._key_points.rows["room_mm3"]

    def move(self, start: Pose, end: Pose) -> Vec3:
        """Move the tool in one tick.

        Args:
            start, end: pose of the tool frame.

        Returns:
            Displacement of the middle of the cutting edge [m], axes of the frame at the end.
        """
        strip = self._key_points
        displacement: Vec3 = _sweep_plates(
            self._points,
            self._normals,
            *start,
            *end,
            strip.segments,
            strip.displacements,
            self._action,
        )
        return displacement

    def rows(self, room_mm3: int = UNLIMITED_ROOM) -> Rows:
        """Return the SWEEP rows of the last motion in the order of the key points.

        Args:
            room_mm3: bank volume that the tool can take in [mm^3].
        """
        self._room.fill(room_mm3)
        return self._key_points.copy()


class DrumSweep:
    """Sweep of a drum: it mills while it is driven, and else compacts."""

    def __init__(self, key_points: NDArray[np.float64], tool_id: int) -> None:
        """
        Args:
            key_points: tips of the picks [m], drum frame, shape (2 * pairs, 3), left first.
            tool_id: id of the tool.
        """
        self._points = key_points
        self._key_points = _KeyPointStrip(len(self._points), tool_id)

    def rows(self, start: Pose, end: Pose, is_driven: bool, work: float) -> Rows:
        """Return the SWEEP rows of one tick in the order of the key points.

        Args:
            start, end: pose of the drum's non-spinning frame.
            is_driven: whether it spins or is commanded to spin.
            work: work that it can deliver to the soil in the tick [J].
        """
        strip = self._key_points
        strip.move(self._points, start, end)
        strip.rows["action"] = _MILL if is_driven else _COMPACT
        strip.rows["work"] = min(work, MAX_MILLING_WORK) if is_driven else 0.0
        return strip.copy()


class TrackSweep:
    """Sweep of a pair of tracks: they compact the ground under their shoes."""

    def __init__(self, tracks: Tracks, first_tool_id: int) -> None:
        """
        Args:
            tracks: the tracks.
            first_tool_id: tool id of the left track; the right track has the next one.
        """
        spec = tracks.spec.tracks
        x, y, half = 0.5 * spec.axle_distance, 0.5 * spec.gauge, 0.5 * spec.shoe_width
        self._points = np.array(
            [
                (along, side + edge, 0.0)
                for side in (y, -y)
                for along in (x, -x)
                for edge in (half, -half)
            ]
        )
        num_points = len(self._points)
        self._key_points = _KeyPointStrip(num_points, first_tool_id)
        self._key_points.rows["pair"] %= 2
        self._key_points.rows["tool"][num_points // 2 :] += 1
        self._key_points.rows["action"] = SweepAction.COMPACT
        self._pressure: NDArray[np.float32] = self._key_points.rows["pressure"].reshape(2, 2, 2)
        self._shoes = box_table(ShoeTable.of(tracks))

    def rows(self, start: Pose, end: Pose) -> Rows:
        """Return the SWEEP rows of one tick: front and rear edge of each track, left track first.

        A machine at rest has no rows: the ground under it is compacted already.

        Args:
            start, end: pose of the base frame, whose origin is on the ground.
        """
        strip = self._key_points
        displacement = _sweep_tracks(
            self._points,
            *start,
            *end,
            self._shoes,
            strip.segments,
            strip.displacements,
            self._pressure,
        )
        if displacement < _MIN_TRACK_DISPLACEMENT:
            return no_rows(SWEEP)
        return strip.copy()


@fixed_signature_kernel
def _move_points(  # type: ignore[no-untyped-def]
    points, rotation, origin, end_rotation, end_origin, segments, displacements
):
    """Compute segments and displacements of key points; see `_KeyPointStrip`.

    Args:
        points: [m], tool frame, shape (n, 3).
        rotation, origin: pose at the start.
        end_rotation, end_origin: pose at the end.
        segments, displacements: out, shapes (n, 6) and (n, 3).

    Returns:
        Maximum component of a displacement [m].
    """
    max_displacement = 0.0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            a = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z + origin[k]
            b = end_rotation[k, 0] * x + end_rotation[k, 1] * y + end_rotation[k, 2] * z
            b += end_origin[k]
            segments[i, k], segments[i, 3 + k], displacements[i, k] = a, b, b - a
            max_displacement = max(max_displacement, abs(b - a))
    return max_displacement


@fixed_signature_kernel
def _sweep_plates(  # type: ignore[no-untyped-def]
    points, normals, rotation, origin, end_rotation, end_origin, segments, displacements, action
):
    """Move key points and find their actions; see `_move_points` and `_classify_actions`.

    Returns:
        Displacement of the middle of the first pair [m], axes of the frame at the end.
    """
    _move_points(points, rotation, origin, end_rotation, end_origin, segments, displacements)
    _classify_actions(displacements, end_rotation, normals, action)
    x, y = (points[0, 0] + points[1, 0]) / 2.0, (points[0, 1] + points[1, 1]) / 2.0
    z = (points[0, 2] + points[1, 2]) / 2.0
    ax, ay, az = rotate_to_map(rotation, x, y, z)
    bx, by, bz = rotate_to_map(end_rotation, x, y, z)
    return rotate_to_frame(
        end_rotation,
        bx + end_origin[0] - ax - origin[0],
        by + end_origin[1] - ay - origin[1],
        bz + end_origin[2] - az - origin[2],
    )


@fixed_signature_kernel
def _sweep_tracks(  # type: ignore[no-untyped-def]
    points,
    rotation,
    origin,
    end_rotation,
    end_origin,
    boxed_shoes,
    segments,
    displacements,
    pressure,
):
    """Move key points at the height of the soles, and set their pressures.

    Args:
        points: see `_move_points`; left track first, the heights are set.
        rotation, origin, end_rotation, end_origin, segments, displacements: see `_move_points`.
        boxed_shoes: `ShoeTable`, boxed.
        pressure: out [Pa], of the left and right edge at front and rear of each track, shape
            (2, 2, 2).

    Returns:
        Maximum component of a displacement [m].
    """
    contact = sole_contact(boxed_shoes.table)
    points_per_side = len(points) // 2
    for side in range(2):
        for k in range(points_per_side):
            points[side * points_per_side + k, 2] = contact.heights[side]
        for edge in range(2):
            pressure[side, 0, edge] = contact.front_pressures[side]
            pressure[side, 1, edge] = contact.rear_pressures[side]
    return _move_points(points, rotation, origin, end_rotation, end_origin, segments, displacements)


@helper
def _classify_actions(displacements, rotation, normals, action):  # type: ignore[no-untyped-def]
    """Set the action of each pair: compact if both ends move along the outward normal, else cut.

    Args:
        displacements: of the key points in the map frame [m], shape (2 * pairs, 3).
        rotation: tool to map.
        normals: outward unit normal at each pair, tool frame, shape (pairs, 3).
        action: out, shape (2 * pairs,).
    """
    for pair in range(len(normals)):
        compacts = True
        for i in range(2 * pair, 2 * pair + 2):
            square, outward = 0.0, 0.0
            for k in range(3):
                component = 0.0
                for j in range(3):
                    component += displacements[i, j] * rotation[j, k]
                square += component * component
                outward += component * normals[pair, k]
            length = math.sqrt(square)
            compacts &= (
                length > _MIN_POINT_DISPLACEMENT and outward > _MIN_COMPACTING_COSINE * length
            )
        for i in range(2 * pair, 2 * pair + 2):
            action[i] = _COMPACT if compacts else _CUT
