"""Sweeps as they come: which tools' rows are sound, and the key-point pairs that cut or press.

Rows come from outside. They are judged before anything is moved, and a tool is believed whole or
not at all: half a tool would cut a shape nobody has.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import Action, Rows
from soil_sim.jit import helper, kernel

__all__ = ["Stroke", "Sweeps", "SweptPairs", "sound_sweeps", "strokes_of"]

_FARTHEST = 1e5
"""Largest coordinate of a key point [m]; there a float32 still tells centimetres apart."""

_LONGEST_WAY = 20.0
"""Longest way of a key point in a tick [m]; at 10 ms that is 2000 m/s."""

_LARGEST_TOOL = 50.0
"""Largest extent of a tool along an axis [m]; the widest blades and buckets are below 25 m."""

_FAULTS = (
    "",
    "rows 2k and 2k+1 of a tool must be the left and right end of pair k; send all its pairs in "
    "order, 0 first, each twice",
    "both ends of a pair must have the same action, 0 to cut, 1 to press or 2 to mill",
    f"a coordinate is not finite or beyond {_FARTHEST:g} m; send map coordinates in metres",
    f"its key points span more than {_LARGEST_TOOL:g} m; send key points of one tool in metres",
    f"a key point moves more than {_LONGEST_WAY:g} m in a tick; start where the last tick ended",
)
"""What is wrong and what to change, by the number of the fault."""

_PRESS = int(Action.PRESS)


class Sweeps(NamedTuple):
    """Sound sweeps of a tick.

    Attributes:
        rows: SWEEP rows by source and tool, those of a tool in the order of its pairs.
        points: start and end of each row's key point [m], map frame, shape (rows, 2, 3).
        first: index of each tool's first row, shape (tools,).
    """

    rows: Rows
    points: NDArray[np.float64]
    first: NDArray[np.int64]


class SweptPairs(NamedTuple):
    """The key-point pairs of one source that cut, or press, over a tick.

    Attributes:
        points: start and end of the tick, left and right end [m], map frame, shape (n, 2, 2, 3).
        joined: whether a plate spans pair k and pair k + 1, shape (n,).
    """

    points: NDArray[np.float64]
    joined: NDArray[np.bool_]


class Stroke(NamedTuple):
    """What the tools of one source do in a tick.

    Attributes:
        source: its number.
        rows: its SWEEP rows.
        cut: the pairs that cut or mill.
        press: the pairs that press.
    """

    source: int
    rows: Rows
    cut: SweptPairs
    press: SweptPairs


def sound_sweeps(sweeps: Rows) -> tuple[Sweeps, tuple[str, ...]]:
    """The sweeps of the tools that can be believed, and what is wrong with the others.

    Args:
        sweeps: SWEEP rows of one tick; a tool's rows in the order of its pairs.

    Returns:
        (sound sweeps, a sentence for each tool left out).
    """
    rows = sweeps[np.lexsort((sweeps["tool"], sweeps["source"]))]
    points, first, faults = _read(rows)
    if not faults.any():
        return Sweeps(rows, points, first), ()
    refused = tuple(
        f"source {rows['source'][first[n]]}, tool {rows['tool'][first[n]]} swept nothing:"
        f" {_FAULTS[faults[n]]}"
        for n in np.flatnonzero(faults)
    )
    rows = rows[np.repeat(faults == 0, np.diff(first, append=rows.size))]
    points, first, _ = _read(rows)
    return Sweeps(rows, points, first), refused


def strokes_of(sweeps: Sweeps) -> list[Stroke]:
    """What each source does in a tick, by their numbers."""
    strokes = []
    start = 0
    while start < sweeps.rows.size:
        cut, press, end = _pairs_of_source(sweeps.rows, sweeps.points, start)
        rows = sweeps.rows[start:end]
        strokes.append(Stroke(int(rows["source"][0]), rows, cut, press))
        start = end
    return strokes


@kernel()
def _read(rows):  # type: ignore[no-untyped-def]
    """Key points, first rows and faults (indices into `_FAULTS`) of tools; rows by tool."""
    points = np.empty((rows.size, 2, 3))
    first = np.empty(rows.size, dtype=np.int64)
    tools = 0
    for n in range(rows.size):
        row = rows[n]
        points[n, 0, 0], points[n, 0, 1], points[n, 0, 2] = row.x0, row.y0, row.z0
        points[n, 1, 0], points[n, 1, 1], points[n, 1, 2] = row.x1, row.y1, row.z1
        if n == 0 or row.source != rows[n - 1].source or row.tool != rows[n - 1].tool:
            first[tools] = n
            tools += 1
    first = first[:tools]
    faults = np.zeros(tools, dtype=np.int64)
    for n in range(tools):
        end = first[n + 1] if n + 1 < tools else rows.size
        faults[n] = _fault(rows, points, first[n], end)
    return points, first, faults


@helper()
def _fault(rows, points, first, end):  # type: ignore[no-untyped-def]
    """The first fault found in the rows of one tool, `first` to `end`; 0 for a sound tool."""
    if (end - first) % 2 == 1:
        return 1
    for n in range(first, end):
        own = n - first
        if rows[n].pair != own // 2:
            return 1
        if rows[n].action > 2 or rows[n].action != rows[n - own % 2].action:
            return 2
        way = 0.0
        for axis in range(3):
            start, stop = points[n, 0, axis], points[n, 1, axis]
            if not (abs(start) <= _FARTHEST and abs(stop) <= _FARTHEST):
                return 3
            way += (stop - start) ** 2
        if way > _LONGEST_WAY**2:
            return 5
    for t in range(2):
        for axis in range(3):
            low = high = points[first, t, axis]
            for n in range(first, end):
                low, high = min(low, points[n, t, axis]), max(high, points[n, t, axis])
            if high - low > _LARGEST_TOOL:
                return 4
    return 0


@kernel()
def _pairs_of_source(rows, points, start):  # type: ignore[no-untyped-def]
    """(pairs that cut, pairs that press, end) of the source whose rows begin at `start`."""
    end = start
    while end < rows.size and rows[end].source == rows[start].source:
        end += 1
    # Of a type and not literals, for each of which Numba would compile `_pairs` anew.
    no, yes = np.bool_(False), np.bool_(True)
    return _pairs(rows, points, start, end, no), _pairs(rows, points, start, end, yes), end


@helper()
def _pairs(rows, points, start, end, pressing):  # type: ignore[no-untyped-def]
    """The pairs of one source's rows, `start` to `end`, that press, or those that do not."""
    left = np.empty((end - start) // 2, dtype=np.int64)  # index of each one's first row
    count = 0
    for n in range(start, end, 2):
        if (rows[n].action == _PRESS) == pressing:
            left[count] = n
            count += 1
    ends = np.empty((count, 2, 2, 3))
    joined = np.zeros(count, dtype=np.bool_)
    for k in range(count):
        for t in range(2):
            for side in range(2):
                for axis in range(3):
                    ends[k, t, side, axis] = points[left[k] + side, t, axis]
        if k > 0:
            here, before = rows[left[k]], rows[left[k - 1]]
            joined[k - 1] = here.tool == before.tool and here.pair == before.pair + 1
    return SweptPairs(ends, joined)
