"""Sweep: where the tool's key points went in a tick, and whether they cut or press there.

Tracks are tools, too: their shoes press the soil they stand on.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.jit import kernel
from machine_sim.machine.description import TrackShape
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.particles import Pose
from machine_sim.work.milling import SPINS
from msg_bridge.contract.rows import SWEEP, Action, Rows, empty_rows

__all__ = ["BucketSweep", "DrumSweep", "TrackSweep"]

_PRESSING = 0.7
"""A plate that moves this much along its outward normal, in parts of its way, presses."""

_AT_REST = 1e-5
"""A key point that moves less than this in a tick [m] does neither; it counts as cutting."""

_STANDS = 2e-4
"""Tracks that move less than this in a tick [m] stand."""

_CUT, _PRESS = int(Action.CUT), int(Action.PRESS)

_ENDS = np.dtype([("ends", "<f4", (6,)), ("rest", f"V{SWEEP.itemsize - 24}")])
"""SWEEP rows with x0 to z1, which come first, as one column."""


class _Strip:
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
        self.ends: NDArray[np.float32] = self.rows.view(_ENDS)["ends"]
        self.ways: NDArray[np.float64] = np.zeros((count, 3))

    def go(self, points: NDArray[np.float64], start: Pose, end: Pose) -> None:
        """Let the points of a frame [m], shape (points, 3), go from one pose to another."""
        _go(points, *start, *end, self.ends, self.ways)


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
        self._strip = _Strip(len(self._points), tool)
        self._action: NDArray[np.uint8] = self._strip.rows["action"]

    def rows(self, start: Pose, end: Pose) -> Rows:
        """SWEEP rows of one tick, lip first, left end of each pair before its right end.

        Args:
            start, end: pose of the tool frame.
        """
        strip = self._strip
        strip.go(self._points, start, end)
        _judge(strip.ways, end[0], self._normals, self._action)
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
        self._strip = _Strip(len(self._points), tool)

    def rows(self, start: Pose, end: Pose, spin: float) -> Rows:
        """SWEEP rows of one tick: the tips of its picks all round, left end first.

        Args:
            start, end: pose of the tool frame, spinning.
            spin: how fast it turns [rad/s].
        """
        strip = self._strip
        strip.go(self._points, start, end)
        strip.rows["action"] = Action.MILL if abs(spin) >= SPINS else Action.PRESS
        return strip.rows.copy()


class TrackSweep:
    """What tracks press: the ground under their shoes, once."""

    def __init__(self, tracks: TrackShape, first_tool: int) -> None:
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
        self._strip = _Strip(count, first_tool)
        self._strip.rows["pair"] %= 2
        self._strip.rows["tool"][count // 2 :] += 1
        self._strip.rows["action"] = Action.PRESS

    def rows(self, start: Pose, end: Pose, soles: ArrayLike = (0.0, 0.0)) -> Rows:
        """SWEEP rows of one tick: front and rear edge of each track, the left one first.

        None while the machine stands: where it stands it has pressed already.

        Args:
            start, end: pose of the base frame, whose origin is on the ground.
            soles: z of the soles in the base frame, left and right [m], shape (2,).
        """
        self._points.reshape(2, -1, 3)[:, :, 2] = np.reshape(soles, (2, 1))
        strip = self._strip
        strip.go(self._points, start, end)
        if np.abs(strip.ways).max() < _STANDS:
            return empty_rows(SWEEP)
        return strip.rows.copy()


@kernel
def _go(points, rotation, origin, end_rotation, end_origin, ends, ways):  # type: ignore[no-untyped-def]
    """See `_Strip`."""
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            a = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z + origin[k]
            b = end_rotation[k, 0] * x + end_rotation[k, 1] * y + end_rotation[k, 2] * z
            b += end_origin[k]
            ends[i, k], ends[i, 3 + k], ways[i, k] = a, b, b - a


@kernel
def _judge(ways, rotation, normals, action):  # type: ignore[no-untyped-def]
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
                    way += ways[i, j] * rotation[j, k]
                square += way * way
                outward += way * normals[pair, k]
            length = math.sqrt(square)
            presses &= length > _AT_REST and outward > _PRESSING * length
        for i in range(2 * pair, 2 * pair + 2):
            action[i] = _PRESS if presses else _CUT
