"""Which regions a tool sweeps, and how much of it each has.

In a tick a tool can take in a volume (`room_mm3`), and a drum can do an amount of work. Regions get
parts of both in proportion to their parts of the edge that cuts: the lip, or all of a drum.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import SWEEP, UNLIMITED_ROOM, Rows, SweepAction, join_rows
from soil_sim.split_terrain.slabs import Slab
from soil_sim.tool_sweeps import ValidSweeps

__all__ = ["SharedSweeps", "ToolKey", "share_sweeps"]

ToolKey = tuple[int, int]
"""Ids of a machine and of a tool of it."""

_POINTS_OF_PAIR = 16
"""Points of a pair of key points by which its share in each region is estimated."""


class SharedSweeps(NamedTuple):
    """Sweeps of a tick by region.

    Attributes:
        rows: SWEEP rows of each region.
        owners: number of the region that has most of each tool, and computes its forces.
    """

    rows: list[Rows]
    owners: dict[ToolKey, int]


def share_sweeps(sweeps: ValidSweeps, grid: Grid, slabs: Sequence[Slab]) -> SharedSweeps:
    """Divide the valid sweeps of a tick among regions.

    A region whose halo a tool is in gets its rows, too, without room: the tool retains soil there.

    Args:
        sweeps: the sweeps.
        grid: the whole grid.
        slabs: rows of the regions.
    """
    parts: list[list[Rows]] = [[] for _ in slabs]
    owners: dict[ToolKey, int] = {}
    last_rows = [slab.end - 0.5 for slab in slabs[:-1]]
    for first, end in pairwise([*sweeps.first_row.tolist(), sweeps.rows.size]):
        rows = sweeps.rows[first:end]
        row_index = grid.row(sweeps.points[first:end, :, 0])
        edge = _points_of_edge(row_index[:, -1], is_drum=rows[0]["action"] == SweepAction.MILL)
        counts = np.bincount(np.searchsorted(last_rows, edge), minlength=len(slabs))
        owner = int(counts.argmax())
        owners[int(rows[0]["machine_id"]), int(rows[0]["tool"])] = owner
        is_held = [row_index.max() > slab.low - 1 and row_index.min() < slab.high for slab in slabs]
        is_held[owner] = True
        rooms = _divide_room(int(rows[0]["room_mm3"]), counts, owner)
        for region in np.flatnonzero(is_held).tolist():
            part = rows.copy()
            part["room_mm3"] = rooms[region]
            part["work"] *= counts[region] / counts.sum()
            parts[region].append(part)
    return SharedSweeps([join_rows(each, SWEEP) for each in parts], owners)


def _points_of_edge(row_index: NDArray[np.float64], *, is_drum: bool) -> NDArray[np.float64]:
    """Return the (fractional) grid rows of points along the edge that cuts, at the end of a tick.

    Args:
        row_index: those of the key points of the tool, left and right ends in turn.
        is_drum: whether all of its pairs cut, of which the last repeats the first, instead of the
            first only.
    """
    ends = row_index.reshape(-1, 2)
    fractions = np.linspace(0.0, 1.0, _POINTS_OF_PAIR)
    left, right = ends[: -1 if is_drum else 1].T
    return np.asarray(left + fractions[:, None] * (right - left)).ravel()


def _divide_room(room: int, counts: NDArray[np.intp], owner: int) -> list[int]:
    """Divide the room of a tool [mm^3] in proportion to counts; what is left goes to the owner."""
    if room == UNLIMITED_ROOM:
        return [room] * counts.size
    total = int(counts.sum())
    rooms = [room * count // total for count in counts.tolist()]
    rooms[owner] += room - sum(rooms)
    return rooms
