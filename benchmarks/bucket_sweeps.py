"""SWEEP rows of a bucket whose lip moves along a path, without a machine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, UNLIMITED_ROOM, Rows, empty_rows

__all__ = [
    "BUCKET_PROFILE",
    "BUCKET_WIDTH",
    "NO_DEPOSIT_REQUESTS",
    "NO_SWEEPS",
    "Point",
    "bucket_ends",
    "bucket_sweep",
]

Point = tuple[float, float, float]
Profile = Sequence[tuple[float, float]]

NO_SWEEPS = empty_rows(SWEEP)
NO_DEPOSIT_REQUESTS = empty_rows(DEPOSIT_REQUEST)

BUCKET_PROFILE: Profile = (
    *((0.0, 0.0), (-0.4, 0.0), (-0.7, 0.1), (-0.9, 0.3)),
    *((-1.0, 0.5), (-1.0, 0.8), (-0.9, 1.0)),
)
"""(x, z) of the seven key points of the bucket, from its lip [m]."""

BUCKET_WIDTH = 1.2
"""[m]"""


def bucket_ends(
    lip: Point, profile: Profile = BUCKET_PROFILE
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the left and right key points (x, y, z) [m], map frame, each of shape (pairs, 3).

    Args:
        lip: middle of the lip (x, y, z) [m], map frame; the lip is parallel to y.
        profile: (x, z) of the key points from the lip [m].
    """
    offsets = np.array(profile, dtype=np.float64)
    middle = np.array(lip) + np.stack([offsets[:, 0], 0.0 * offsets[:, 0], offsets[:, 1]], axis=1)
    half_width = np.array([0.0, 0.5 * BUCKET_WIDTH, 0.0])
    return middle + half_width, middle - half_width


def bucket_sweep(start: Point, end: Point, profile: Profile = BUCKET_PROFILE) -> Rows:
    """Return SWEEP rows of machine 1: the middle of the lip moves from `start` to `end` [m]."""
    rows = empty_rows(SWEEP, 2 * len(profile))
    rows["room_mm3"] = UNLIMITED_ROOM
    rows["machine_id"], rows["pair"] = 1, np.repeat(np.arange(len(profile)), 2)
    for moment, lip in enumerate((start, end)):
        sides = np.stack(bucket_ends(lip, profile), axis=1).reshape(-1, 3)  # left, right of a pair
        for axis, name in enumerate("xyz"):
            rows[f"{name}{moment}"] = sides[:, axis]
    return rows
