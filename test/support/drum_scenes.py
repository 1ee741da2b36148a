"""SWEEP rows of a drum without a machine."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.contract.rows import SWEEP, UNLIMITED_ROOM, Rows, SweepAction, empty_rows

RADIUS, WIDTH = 0.5, 1.0
"""Radius and length of the drum [m]; its axis is along y."""
_PAIRS = 16


def drum_ring(center: ArrayLike, angle: float = 0.0) -> NDArray[np.float64]:
    """Return the key points of a drum [m], left before right, as a closed ring, shape (34, 3)."""
    turns = angle + 2.0 * math.pi * np.arange(_PAIRS + 1) / _PAIRS
    points = [
        (RADIUS * math.cos(a), side * 0.5 * WIDTH, -RADIUS * math.sin(a))
        for a in turns
        for side in (1, -1)
    ]
    return np.array(points) + np.asarray(center)


def drum_sweep(
    start: ArrayLike,
    end: ArrayLike,
    work: float = 0.0,
    action: SweepAction = SweepAction.MILL,
    angle: float = 0.0,
) -> Rows:
    """Return the rows of a drum whose middle moves from `start` to `end` [m] in a tick."""
    before, after = drum_ring(start, angle), drum_ring(end, angle)
    rows = empty_rows(SWEEP, len(before))
    rows["x0"], rows["y0"], rows["z0"] = before.T
    rows["x1"], rows["y1"], rows["z1"] = after.T
    rows["pair"] = np.arange(len(before)) // 2
    rows["action"], rows["machine_id"], rows["work"] = action, 1, work
    rows["room_mm3"] = UNLIMITED_ROOM
    return rows
