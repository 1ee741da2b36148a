"""Sweep: where the tool's key points went in a tick, and whether they cut or press there."""

from __future__ import annotations

import numpy as np

from machine_sim.machine.bucket import BucketShape
from machine_sim.particles import Pose
from msg_bridge.contract.rows import SWEEP, Action, Rows, empty_rows

__all__ = ["sweep_rows"]

_PRESSING = 0.7
"""A plate that moves this much along its outward normal, in parts of its way, presses."""

_AT_REST = 1e-5
"""A key point that moves less than this in a tick [m] does neither; it counts as cutting."""


def sweep_rows(bucket: BucketShape, start: Pose, end: Pose, *, tool: int) -> Rows:
    """SWEEP rows of one tick, lip first, left end of each pair before its right end.

    A bucket cuts with its lip leading; pushed down on its back it presses soil, it takes none.

    Args:
        bucket: the tool.
        start, end: pose of the tool frame.
        tool: number of the tool on its machine.
    """
    points = bucket.key_points()
    a = points @ start[0].T + start[1]
    b = points @ end[0].T + end[1]
    rows = empty_rows(SWEEP, len(points))
    rows["x0"], rows["y0"], rows["z0"] = a.T
    rows["x1"], rows["y1"], rows["z1"] = b.T
    rows["pair"] = np.arange(len(points)) // 2
    rows["tool"] = tool
    way = (b - a) @ end[0]  # in the tool frame
    outward = np.repeat(bucket.outward_normals(), 2, axis=0)
    length = np.linalg.norm(way, axis=1)
    pressing = (length > _AT_REST) & ((way * outward).sum(axis=1) > _PRESSING * length)
    both = pressing.reshape(-1, 2).all(axis=1)
    rows["action"] = np.where(np.repeat(both, 2), Action.PRESS, Action.CUT)
    return rows
