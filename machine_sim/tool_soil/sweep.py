"""Sweep: where the tool's key points went in a tick, and whether they cut or press there.

Tracks are tools, too: their shoes press the soil they stand on.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem import Pose
from machine_sim.machine.spec import TrackSpec
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.tool_soil.milling_resistance import MIN_MILLING_SPEED
from msg_bridge.contract.rows import SWEEP, Rows, SweepAction, empty_rows
from msg_bridge.kernels import kernel

__all__ = ["BucketSweep", "DrumSweep", "TrackSweep"]

_MIN_PRESSING_COSINE = 0.7
"""A plate that moves this much along its outward normal, in parts of its way, presses."""

_MIN_POINT_DISPLACEMENT = 1e-5
"""A key point that moves less than this in a tick [m] does neither; it counts as cutting."""

_MIN_TRACK_DISPLACEMENT = 2e-4
"""Tracks that move less than this in a tick [m] stand."""

_CUT, _PRESS = int(SweepAction.CUT), int(SweepAction.COMPACT)

_SEGMENT_DTYPE = np.dtype([("ends", "<f4", (6,)), ("rest", f"V{SWEEP.itemsize - 24}")])
"""SWEEP rows with x0 to z1, which come first, as one column."""


class _KeyPointStrip:
    """The rows of a strip of key points, in which only the ways and actions change.

    Attributes:
        rows: SWEEP rows, written anew each tick.
        ends: their x0 to z1 [m], a view, shape (points, 6).
        ways: from x0, y0, z0 to x1, y1, z1 [m], not rounded, shape (points, 3).
    """

    def __init__(self, count: int, tool: int) -> None:
        """
        Args:
            count: of key points, two a pair.
            tool: number of the tool.
        """
        self.rows = empty_rows(SWEEP, count)
        self.rows["pair"] = np.arange(count) // 2
        self.rows["tool"] = tool
        self.segments: NDArray[np.float32] = self.rows.view(_SEGMENT_DTYPE)["ends"]
        self.displacements: NDArray[np.float64] = np.zeros((count, 3))

    def move(self, points: NDArray[np.float64], start: Pose, end: Pose) -> None:
        """Let the points of a frame [m], shape (points, 3), go from one pose to another."""
        _move_points(points, *start, *end, self.segments, self.displacements)


class BucketSweep:
    """What a bucket sweeps: it cuts with its lip leading.

    Pushed down on its back it presses soil, it takes none.
    """

    def __init__(self, bucket: BucketShape, tool: int) -> None:
        """
        Args:
            bucket: the tool.
            tool: its number.
        """
        self._points, self._normals = bucket.key_points, bucket.outward_normals
        self._key_points = _KeyPointStrip(len(self._points), tool)
        self._action: NDArray[np.uint8] = self._key_points.rows["action"]

    def rows(self, start: Pose, end: Pose) -> Rows:
        """SWEEP rows of one tick, lip first, left end of each pair before its right end.

        Args:
            start, end: pose of the tool frame.
        """
        strip = self._key_points
        strip.move(self._points, start, end)
        _classify_actions(strip.displacements, end[0], self._normals, self._action)
        return strip.rows.copy()


class DrumSweep:
    """What a drum sweeps: it cuts while it spins; one that stands presses."""

    def __init__(self, drum: DrumShape, tool: int) -> None:
        """
        Args:
            drum: the tool.
            tool: its number.
        """
        self._points = drum.key_points
        self._key_points = _KeyPointStrip(len(self._points), tool)

    def rows(self, start: Pose, end: Pose, spin: float) -> Rows:
        """SWEEP rows of one tick: the tips of its picks all round, left end first.

        Args:
            start, end: pose of the tool frame, spinning.
            spin: how fast it turns [rad/s].
        """
        strip = self._key_points
        strip.move(self._points, start, end)
        strip.rows["action"] = (
            SweepAction.MILL if abs(spin) >= MIN_MILLING_SPEED else SweepAction.COMPACT
        )
        return strip.rows.copy()


class TrackSweep:
    """What tracks press: the ground under their shoes, once."""

    def __init__(self, tracks: TrackSpec, first_tool: int) -> None:
        """
        Args:
            tracks: shape of the tracks.
            first_tool: number of the left track; the right one has the next.
        """
        x, y, half = 0.5 * tracks.axle_distance, 0.5 * tracks.gauge, 0.5 * tracks.shoe_width
        self._points = np.array(
            [
                (along, side + edge, 0.0)
                for side in (y, -y)
                for along in (x, -x)
                for edge in (half, -half)
            ]
        )
        count = len(self._points)
        self._key_points = _KeyPointStrip(count, first_tool)
        self._key_points.rows["pair"] %= 2
        self._key_points.rows["tool"][count // 2 :] += 1
        self._key_points.rows["action"] = SweepAction.COMPACT

    def rows(self, start: Pose, end: Pose, soles: ArrayLike = (0.0, 0.0)) -> Rows:
        """SWEEP rows of one tick: front and rear edge of each track, the left one first.

        None while the machine stands: where it stands it has pressed already.

        Args:
            start, end: pose of the base frame, whose origin is on the ground.
            soles: z of the soles in the base frame, left and right [m], shape (2,).
        """
        self._points.reshape(2, -1, 3)[:, :, 2] = np.reshape(soles, (2, 1))
        strip = self._key_points
        strip.move(self._points, start, end)
        if np.abs(strip.displacements).max() < _MIN_TRACK_DISPLACEMENT:
            return empty_rows(SWEEP)
        return strip.rows.copy()


@kernel
def _move_points(points, rotation, origin, end_rotation, end_origin, ends, displacements):  # type: ignore[no-untyped-def]
    """See `_Strip`."""
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            a = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z + origin[k]
            b = end_rotation[k, 0] * x + end_rotation[k, 1] * y + end_rotation[k, 2] * z
            b += end_origin[k]
            ends[i, k], ends[i, 3 + k], displacements[i, k] = a, b, b - a


@kernel
def _classify_actions(displacements, rotation, normals, action):  # type: ignore[no-untyped-def]
    """Whether each pair of key points presses, both ends of it, or cuts.

    Args:
        ways: of the key points in the map frame [m], shape (2 * pairs, 3).
        rotation: tool to map.
        normals: outward at each pair, tool frame, shape (pairs, 3).
        action: out, shape (2 * pairs,).
    """
    for pair in range(len(normals)):
        presses = True
        for i in range(2 * pair, 2 * pair + 2):
            square, outward = 0.0, 0.0
            for k in range(3):
                way = 0.0
                for j in range(3):
                    way += displacements[i, j] * rotation[j, k]
                square += way * way
                outward += way * normals[pair, k]
            length = math.sqrt(square)
            presses &= length > _MIN_POINT_DISPLACEMENT and outward > _MIN_PRESSING_COSINE * length
        for i in range(2 * pair, 2 * pair + 2):
            action[i] = _PRESS if presses else _CUT
