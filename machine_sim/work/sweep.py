"""Sweep: where the tool's key points went in a tick, and whether they cut or press there.

Tracks are tools, too: their shoes press the soil they stand on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.description import TrackShape
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.particles import Pose
from machine_sim.work.milling import SPINS
from msg_bridge.contract.rows import SWEEP, Action, Rows, empty_rows

__all__ = ["drum_rows", "sweep_rows", "track_rows"]

_PRESSING = 0.7
"""A plate that moves this much along its outward normal, in parts of its way, presses."""

_AT_REST = 1e-5
"""A key point that moves less than this in a tick [m] does neither; it counts as cutting."""


_STANDS = 2e-4
"""Tracks that move less than this in a tick [m] stand."""


def sweep_rows(bucket: BucketShape, start: Pose, end: Pose, *, tool: int) -> Rows:
    """SWEEP rows of one tick, lip first, left end of each pair before its right end.

    A bucket cuts with its lip leading; pushed down on its back it presses soil, it takes none.

    Args:
        bucket: the tool.
        start, end: pose of the tool frame.
        tool: number of the tool on its machine.
    """
    points = bucket.key_points
    a = points @ start[0].T + start[1]
    b = points @ end[0].T + end[1]
    rows = empty_rows(SWEEP, len(points))
    rows["x0"], rows["y0"], rows["z0"] = a.T
    rows["x1"], rows["y1"], rows["z1"] = b.T
    rows["pair"] = np.arange(len(points)) // 2
    rows["tool"] = tool
    way = (b - a) @ end[0]  # in the tool frame
    outward = np.repeat(bucket.outward_normals, 2, axis=0)
    length = np.linalg.norm(way, axis=1)
    pressing = (length > _AT_REST) & ((way * outward).sum(axis=1) > _PRESSING * length)
    both = pressing.reshape(-1, 2).all(axis=1)
    rows["action"] = np.where(np.repeat(both, 2), Action.PRESS, Action.CUT)
    return rows


def drum_rows(drum: DrumShape, start: Pose, end: Pose, *, spin: float, tool: int) -> Rows:
    """SWEEP rows of one tick of a drum: the tips of its picks all round, left end first.

    It cuts while it spins; one that stands presses.

    Args:
        drum: the tool.
        start, end: pose of the tool frame, spinning.
        spin: how fast it turns [rad/s].
        tool: number of the tool.
    """
    points = drum.key_points
    rows = empty_rows(SWEEP, len(points))
    a = points @ start[0].T + start[1]
    b = points @ end[0].T + end[1]
    rows["x0"], rows["y0"], rows["z0"] = a.T
    rows["x1"], rows["y1"], rows["z1"] = b.T
    rows["pair"] = np.arange(len(points)) // 2
    rows["tool"] = tool
    rows["action"] = Action.MILL if abs(spin) >= SPINS else Action.PRESS
    return rows


def track_rows(
    tracks: TrackShape,
    start: Pose,
    end: Pose,
    *,
    first_tool: int,
    soles: tuple[float, float] | NDArray[np.float64] = (0.0, 0.0),
) -> Rows:
    """SWEEP rows of what the tracks press in a tick: front and rear edge of each, left track first.

    None while the machine stands: where it stands it has pressed already.

    Args:
        tracks: shape of the tracks.
        start, end: pose of the base frame, whose origin is on the ground.
        first_tool: number of the left track; the right one has the next.
        soles: z of the soles in the base frame, left and right [m].
    """
    x, y = 0.5 * tracks.axle_distance, 0.5 * tracks.gauge
    half = 0.5 * tracks.shoe_width
    points = np.array(
        [
            (along, side + edge, sole)
            for side, sole in zip((y, -y), soles, strict=True)
            for along in (x, -x)
            for edge in (half, -half)
        ]
    )
    a = points @ start[0].T + start[1]
    b = points @ end[0].T + end[1]
    if np.abs(b - a).max() < _STANDS:
        return empty_rows(SWEEP)
    rows = empty_rows(SWEEP, len(points))
    rows["x0"], rows["y0"], rows["z0"] = a.T
    rows["x1"], rows["y1"], rows["z1"] = b.T
    rows["pair"] = np.arange(len(points)) // 2 % 2
    rows["tool"] = first_tool + np.arange(len(points)) // 4
    rows["action"] = Action.PRESS
    return rows
