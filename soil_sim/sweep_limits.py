"""Limits of the motion of a tool from tick to tick: its speed, its continuity and its shape.

A tool moves continuously, at a limited speed, and keeps its shape. Sweeps that violate this do not
come from its machine: they would cut where the tool is not. Tools are rejected one by one; the
history of a rejected tool is kept, so that the next valid sweep is accepted.

`tool_sweeps` checks, after these limits, what needs no history: the order of the rows, and that
coordinates, displacements and extents are possible for any tool. Those checks protect the kernels
and apply to every caller of `Soil.step`; the limits here apply to sweeps that machines send.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import SWEEP_SEGMENT, Rows, SweepAction
from msg_bridge.kernels import kernel

__all__ = ["SweepLimits"]

_GAP_TOLERANCE = 0.02
"""Distance between the end of a sweep and the start of the next that counts as none [m]: float32
resolves a centimetre at 100 km."""

_SHAPE_TOLERANCE = 0.1
"""Change of the distance of two key points of a tool that counts as none [m]."""

_PRESSING_GAP_TOLERANCE = 0.3
"""The same of a tool that only compacts [m]: the height of soles changes as shoes are unloaded."""

_NUM_CONTINUOUS_TICKS = 20
"""Ticks of continuous motion after which a tool is accepted at another place: its machine was
moved."""

Points = NDArray[np.float64]


@dataclass
class _Tool:
    """Last accepted sweep of a tool, and the motion that was rejected since.

    Attributes:
        ends: key points at its end [m], shape (n, 3).
        lengths: distances between successive key points [m], shape (n - 1,).
        tick: its tick.
        rejected_ends: those of the last rejected sweep; None without one.
        num_continuous: number of rejected sweeps in succession that are continuous.
    """

    ends: Points
    lengths: Points
    tick: int
    rejected_ends: Points | None = None
    num_continuous: int = 0


_Tools = dict[int, _Tool]
"""Tools of a machine by id."""


class SweepLimits:
    """Checks the sweeps of all machines, tick by tick."""

    def __init__(self, max_displacement: float) -> None:
        """
        Args:
            max_displacement: maximum displacement of a key point in a tick [m].
        """
        self._max_displacement = max_displacement
        self._session_ids: dict[int, int] = {}  # by machine id
        self._machines: dict[int, _Tools] = {}  # by machine id

    def check(self, tick: int, sweeps: Rows) -> tuple[Rows, tuple[str, ...]]:
        """Separate possible sweeps from impossible ones.

        Args:
            tick: number of the soil's tick.
            sweeps: SWEEP rows of all machines; the rows of a tool are contiguous.

        Returns:
            (rows of the accepted tools, a message for each rejected tool).
        """
        if sweeps.size == 0:
            return sweeps, ()
        segments = sweeps.view(SWEEP_SEGMENT)["ends"].astype(np.float64).reshape(-1, 2, 3)
        # Of some twenty rows: each operation of NumPy would take as long as the loop.
        actions = sweeps["action"].tolist()
        owners = zip(sweeps["machine_id"].tolist(), sweeps["tool"].tolist(), strict=True)
        rejected: list[int] = []
        messages, end = [], 0
        for (machine_id, tool), rows in groupby(owners):
            begin, end = end, end + len(list(rows))
            tools = self._machines.setdefault(machine_id, {})
            is_pressing = all(each == SweepAction.COMPACT for each in actions[begin:end])
            tolerance = _PRESSING_GAP_TOLERANCE if is_pressing else _GAP_TOLERANCE
            fault = self._find_fault(tools, tool, tick, segments[begin:end], tolerance)
            if fault:
                rejected += range(begin, end)
                messages.append(f"machine {machine_id}, tool {tool} is rejected: {fault}")
        return np.delete(sweeps, rejected) if rejected else sweeps, tuple(messages)

    def update_sessions(self, session_ids: Mapping[int, int]) -> None:
        """Remove the tools of machines whose session has ended.

        Args:
            session_ids: session of each machine that takes part, by machine id.
        """
        for machine_id in list(self._machines):
            if session_ids.get(machine_id) != self._session_ids.get(machine_id):
                del self._machines[machine_id]
        self._session_ids = dict(session_ids)

    def _find_fault(
        self, tools: _Tools, tool: int, tick: int, segments: Points, tolerance: float
    ) -> str:
        """Return what is impossible in the sweep of a tool; empty if nothing is.

        Coordinates that are not finite are left to `tool_sweeps`.
        """
        ends, lengths = np.empty((len(segments), 3)), np.empty(len(segments) - 1)
        displacement = _measure(segments, ends, lengths)
        if not math.isfinite(displacement):
            return ""
        if displacement > self._max_displacement:
            return (
                f"a key point moves {displacement:.2f} m in a tick, and at most"
                f" {self._max_displacement:g} m are possible at max_tool_speed"
            )
        sweep, known = _Tool(ends, lengths, tick), tools.get(tool)
        fault = "" if known is None else self._find_jump(known, sweep, segments, tolerance)
        if known is not None and fault and not _has_been_moved(known, segments[:, 0], ends):
            return fault
        if known is not None and not fault:
            sweep.lengths = known.lengths  # of its first sweep, so that the shape cannot drift
        tools[tool] = sweep
        return ""

    def _find_jump(self, known: _Tool, sweep: _Tool, segments: Points, tolerance: float) -> str:
        """Return how a sweep does not continue that of its tool before; empty if it does."""
        fault = "its key points are not those of its first sweep"
        if sweep.lengths.size != known.lengths.size:
            return fault
        change, gap = _compare(segments, sweep.lengths, known.ends, known.lengths)
        if change > _SHAPE_TOLERANCE:
            return fault
        # A track at rest has no sweeps: it may have crept since its last one.
        most = tolerance + self._max_displacement * max(sweep.tick - known.tick - 1, 0)
        return "" if gap <= most else f"its sweep begins {gap:.2f} m from the end of its last one"


@kernel
def _measure(segments, ends, lengths):  # type: ignore[no-untyped-def]
    """Measure a sweep.

    Args:
        segments: key points at its start and at its end [m], shape (n, 2, 3).
        ends: out: key points at its end [m], shape (n, 3).
        lengths: out: distances between successive ones [m], shape (n - 1,).

    Returns:
        The largest change of a coordinate [m]; not finite if a coordinate is not.
    """
    largest = 0.0
    for k in range(len(segments)):
        square = 0.0
        for axis in range(3):
            ends[k, axis] = segments[k, 1, axis]
            change = abs(segments[k, 1, axis] - segments[k, 0, axis])
            if not math.isfinite(change):
                return change
            largest = max(largest, change)
            if k > 0:
                square += (ends[k, axis] - ends[k - 1, axis]) ** 2
        if k > 0:
            lengths[k - 1] = math.sqrt(square)
    return largest


@kernel
def _compare(segments, lengths, ends_before, lengths_before):  # type: ignore[no-untyped-def]
    """Compare a sweep with the one of its tool before, of as many key points.

    Returns:
        The largest change of a distance between two key points [m], and the largest difference of a
        coordinate from the end of the sweep before [m].
    """
    change = gap = 0.0
    for k in range(len(lengths)):
        change = max(change, abs(lengths[k] - lengths_before[k]))
    for k in range(len(segments)):
        for axis in range(3):
            gap = max(gap, abs(segments[k, 0, axis] - ends_before[k, axis]))
    return change, gap


def _has_been_moved(known: _Tool, starts: Points, ends: Points) -> bool:
    """Return whether a tool has moved continuously elsewhere for long enough."""
    before = known.rejected_ends
    is_continuous = (
        before is not None
        and before.shape == starts.shape
        and np.abs(starts - before).max() <= _PRESSING_GAP_TOLERANCE
    )
    known.num_continuous = known.num_continuous + 1 if is_continuous else 0
    known.rejected_ends = ends
    return known.num_continuous >= _NUM_CONTINUOUS_TICKS
