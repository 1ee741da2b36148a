"""Sweeps as they come: which tools' rows are sound, and the key-point pairs that cut or press.

Rows come from outside. They are judged before anything is moved, and a tool is believed whole or
not at all: half a tool would cut a shape nobody has.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import Rows, SweepAction
from msg_bridge.kernels import helper, kernel

__all__ = ["SourceSweeps", "SweptPairs", "ValidSweeps", "group_by_machine", "validate_sweeps"]

_MAX_COORDINATE = 1e5
"""Largest coordinate of a key point [m]; there a float32 still tells centimetres apart."""

_MAX_DISPLACEMENT = 20.0
"""Longest way of a key point in a tick [m]; at 10 ms that is 2000 m/s."""

_MAX_TOOL_EXTENT = 50.0
"""Largest extent of a tool along an axis [m]; the widest blades and buckets are below 25 m."""

_FAULT_MESSAGES = (
    "",
    "rows 2k and 2k+1 of a tool must be the left and right end of pair k; send all its pairs in "
    "order, 0 first, each twice",
    "both ends of a pair must have the same action, 0 to cut, 1 to press or 2 to mill",
    f"a coordinate is not finite or beyond {_MAX_COORDINATE:g} m; send map coordinates in metres",
    f"its key points span more than {_MAX_TOOL_EXTENT:g} m; send key points of one tool in metres",
    f"a key point moves more than {_MAX_DISPLACEMENT:g} m in a tick; start where the last tick ended",
)
"""What is wrong and what to change, by the number of the fault."""

_PRESS = int(SweepAction.COMPACT)


class ValidSweeps(NamedTuple):
    """Sound sweeps of a tick.

    Attributes:
        rows: SWEEP rows by source and tool, those of a tool in the order of its pairs.
        points: start and end of each row's key point [m], map frame, shape (rows, 2, 3).
        first: index of each tool's first row, shape (tools,).
    """

    rows: Rows
    points: NDArray[np.float64]
    first_row: NDArray[np.int64]


class SweptPairs(NamedTuple):
    """The key-point pairs of one source that cut, or press, over a tick.

    Attributes:
        points: start and end of the tick, left and right end [m], map frame, shape (n, 2, 2, 3).
        joined: whether a plate spans pair k and pair k + 1, shape (n,).
    """

    points: NDArray[np.float64]
    has_plate: NDArray[np.bool_]


class SourceSweeps(NamedTuple):
    """What the tools of one source do in a tick.

    Attributes:
        source: its number.
        rows: its SWEEP rows.
        cut: the pairs that cut or mill.
        press: the pairs that press.
    """

    machine_id: int
    rows: Rows
    cut_pairs: SweptPairs
    press_pairs: SweptPairs


def validate_sweeps(sweeps: Rows) -> tuple[ValidSweeps, tuple[str, ...]]:
    """The sweeps of the tools that can be believed, and what is wrong with the others.

    Args:
        sweeps: SWEEP rows of one tick; a tool's rows in the order of its pairs.

    Returns:
        (sound sweeps, a sentence for each tool left out).
    """
    rows = sweeps[np.lexsort((sweeps["tool"], sweeps["machine_id"]))]
    points, first_row, faults = _parse_tools(rows)
    if not faults.any():
        return ValidSweeps(rows, points, first_row), ()
    refused = tuple(
        f"machine {rows['machine_id'][first_row[n]]}, tool {rows['tool'][first_row[n]]} swept nothing:"
        f" {_FAULT_MESSAGES[faults[n]]}"
        for n in np.flatnonzero(faults)
    )
    rows = rows[np.repeat(faults == 0, np.diff(first_row, append=rows.size))]
    points, first_row, _ = _parse_tools(rows)
    return ValidSweeps(rows, points, first_row), refused


def group_by_machine(sweeps: ValidSweeps) -> list[SourceSweeps]:
    """What each source does in a tick, by their numbers."""
    strokes = []
    start = 0
    while start < sweeps.rows.size:
        cut_pairs, press_pairs, end = _split_machine(sweeps.rows, sweeps.points, start)
        rows = sweeps.rows[start:end]
        strokes.append(SourceSweeps(int(rows["machine_id"][0]), rows, cut_pairs, press_pairs))
        start = end
    return strokes


@kernel
def _parse_tools(rows):  # type: ignore[no-untyped-def]
    """Key points, first rows and faults (indices into `_FAULT_MESSAGES`) of tools; rows by tool."""
    points = np.empty((rows.size, 2, 3))
    first_row = np.empty(rows.size, dtype=np.int64)
    tools = 0
    for n in range(rows.size):
        row = rows[n]
        points[n, 0, 0], points[n, 0, 1], points[n, 0, 2] = row.x0, row.y0, row.z0
        points[n, 1, 0], points[n, 1, 1], points[n, 1, 2] = row.x1, row.y1, row.z1
        if n == 0 or row.machine_id != rows[n - 1].machine_id or row.tool != rows[n - 1].tool:
            first_row[tools] = n
            tools += 1
    first_row = first_row[:tools]
    faults = np.zeros(tools, dtype=np.int64)
    for n in range(tools):
        end = first_row[n + 1] if n + 1 < tools else rows.size
        faults[n] = _find_fault(rows, points, first_row[n], end)
    return points, first_row, faults


@helper
def _find_fault(rows, points, first_row, end):  # type: ignore[no-untyped-def]
    """The first fault found in the rows of one tool, `first` to `end`; 0 for a sound tool."""
    if (end - first_row) % 2 == 1:
        return 1
    for n in range(first_row, end):
        own = n - first_row
        if rows[n].pair != own // 2:
            return 1
        if rows[n].action > 2 or rows[n].action != rows[n - own % 2].action:
            return 2
        way = 0.0
        for axis in range(3):
            start, stop = points[n, 0, axis], points[n, 1, axis]
            if not (abs(start) <= _MAX_COORDINATE and abs(stop) <= _MAX_COORDINATE):
                return 3
            way += (stop - start) ** 2
        if way > _MAX_DISPLACEMENT**2:
            return 5
    for t in range(2):
        for axis in range(3):
            low = high = points[first_row, t, axis]
            for n in range(first_row, end):
                low, high = min(low, points[n, t, axis]), max(high, points[n, t, axis])
            if high - low > _MAX_TOOL_EXTENT:
                return 4
    return 0


@kernel
def _split_machine(rows, points, start):  # type: ignore[no-untyped-def]
    """(pairs that cut, pairs that press, end) of the source whose rows begin at `start`."""
    end = start
    while end < rows.size and rows[end].machine_id == rows[start].machine_id:
        end += 1
    # Of a type and not literals, for each of which Numba would compile `_pairs` anew.
    no, yes = np.bool_(False), np.bool_(True)
    return (
        _select_pairs(rows, points, start, end, no),
        _select_pairs(rows, points, start, end, yes),
        end,
    )


@helper
def _select_pairs(rows, points, start, end, pressing):  # type: ignore[no-untyped-def]
    """The pairs of one source's rows, `start` to `end`, that press, or those that do not."""
    left = np.empty((end - start) // 2, dtype=np.int64)  # index of each one's first row
    count = 0
    for n in range(start, end, 2):
        if (rows[n].action == _PRESS) == pressing:
            left[count] = n
            count += 1
    ends = np.empty((count, 2, 2, 3))
    has_plate = np.zeros(count, dtype=np.bool_)
    for k in range(count):
        for t in range(2):
            for side in range(2):
                for axis in range(3):
                    ends[k, t, side, axis] = points[left[k] + side, t, axis]
        if k > 0:
            here, before = rows[left[k]], rows[left[k - 1]]
            has_plate[k - 1] = here.tool == before.tool and here.pair == before.pair + 1
    return SweptPairs(ends, has_plate)
