"""Validation of tool sweeps, and their split into key-point pairs that cut and that compact.

SWEEP rows come from outside. They are validated before any soil moves, and a tool is accepted or
rejected as a whole: half of the rows would cut a shape that no tool has.

The checks are of one tick and hold for any tool: order of the rows, actions, and values that the
kernels can process. `sweep_limits` checks before them what depends on the machine and on the ticks
before: `max_tool_speed`, the continuity of the motion, and that a tool keeps its shape.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import MAX_MILLING_WORK, SWEEP, Rows, SweepAction
from msg_bridge.kernels import helper, kernel

__all__ = [
    "CutSweep",
    "MachineSweeps",
    "SweptPairs",
    "ValidSweeps",
    "group_by_machine",
    "interpolate_key_point",
    "positions_of_first_tools",
    "validate_sweeps",
]

_MAX_COORDINATE = 1e5
"""Largest coordinate of a key point [m]; a float32 still resolves a centimetre there."""

_MAX_DISPLACEMENT = 20.0
"""Largest displacement of a key point in a tick [m]; at 10 ms that is 2000 m/s."""

_MAX_TOOL_EXTENT = 50.0
"""Largest extent of a tool along an axis [m]; the widest blades and buckets are below 25 m."""


class SweepFault(IntEnum):
    """Reason for which the rows of a tool are rejected."""

    NONE = 0
    PAIR_ORDER = 1
    ACTION = 2
    COORDINATE = 3
    EXTENT = 4
    DISPLACEMENT = 5
    ROOM = 6
    WORK = 7


_FAULT_MESSAGES = {
    SweepFault.PAIR_ORDER: "rows 2k and 2k+1 of a tool must be the left and right end of pair k;"
    " send all its pairs in order, 0 first, each twice",
    SweepFault.ACTION: "both ends of a pair must have the same action: 0 to cut, 1 to press or"
    " 2 to mill; a tool that mills does so with all pairs",
    SweepFault.COORDINATE: f"a coordinate is not finite or beyond {_MAX_COORDINATE:g} m; send map"
    " coordinates in metres",
    SweepFault.EXTENT: f"its key points span more than {_MAX_TOOL_EXTENT:g} m; send the key points"
    " of one tool in metres",
    SweepFault.ROOM: "all rows of a tool must have the same room_mm3, the bank volume that the tool"
    " can take in",
    SweepFault.DISPLACEMENT: f"a key point moves more than {_MAX_DISPLACEMENT:g} m in a tick; start"
    " where the last tick ended",
    SweepFault.WORK: f"its work is not between 0 and {MAX_MILLING_WORK:g} J, differs from row to"
    " row, or is not 0 although it does not mill; send the work that the drum can deliver in the"
    " tick",
}
"""What is wrong with the rows and what to change."""

_NO_FAULT, _PAIR_ORDER, _ACTION, _ROOM = (
    int(SweepFault.NONE),
    int(SweepFault.PAIR_ORDER),
    int(SweepFault.ACTION),
    int(SweepFault.ROOM),
)
_COORDINATE, _EXTENT, _DISPLACEMENT, _WORK = (
    int(SweepFault.COORDINATE),
    int(SweepFault.EXTENT),
    int(SweepFault.DISPLACEMENT),
    int(SweepFault.WORK),
)
_COMPACT, _MILL = int(SweepAction.COMPACT), int(SweepAction.MILL)
_WORK_FIELD, _ACTION_FIELD, _ROOM_FIELD, _MACHINE_FIELD, _TOOL_FIELD = (
    SWEEP.names.index(name)  # type: ignore[union-attr]
    for name in ("work", "action", "room_mm3", "machine_id", "tool")
)
_LAST_ACTION = int(max(SweepAction))


class ValidSweeps(NamedTuple):
    """Valid sweeps of a tick.

    Attributes:
        rows: SWEEP rows sorted by machine and tool, those of a tool in the order of its pairs.
        points: key point of each row at the start and end of the tick [m], map frame,
            shape (rows, 2, 3), float64.
        first_row: index of the first row of each tool, shape (tools,), int64.
    """

    rows: Rows
    points: NDArray[np.float64]
    first_row: NDArray[np.int64]


class SweptPairs(NamedTuple):
    """Key-point pairs of one machine that cut, or that compact, in a tick.

    Attributes:
        points: key points [m], map frame, shape (pairs, 2, 2, 3), float64: of each pair at the
            start and end of the tick, its left and right end.
        has_plate: whether a plate spans pair k and pair k + 1, shape (pairs,), bool.
    """

    points: NDArray[np.float64]
    has_plate: NDArray[np.bool_]


class CutSweep(NamedTuple):
    """Pairs of one tool that cut or mill in a tick.

    Attributes:
        pairs: the pairs.
        room_mm3: bank volume that the tool can take in [mm^3]; `UNLIMITED_ROOM` if any.
        machine_id: id of its machine.
        tool: id of the tool.
        work: work that it can deliver if it mills [J]; None if it cuts.
    """

    pairs: SweptPairs
    room_mm3: int
    machine_id: int
    tool: int
    work: float | None


class MachineSweeps(NamedTuple):
    """Sweeps of the tools of one machine in a tick.

    Attributes:
        machine_id: id of the machine.
        rows: its SWEEP rows.
        cuts: the pairs that cut or mill, by tool.
        press_pairs: the pairs that compact.
    """

    machine_id: int
    rows: Rows
    cuts: list[CutSweep]
    press_pairs: SweptPairs


def validate_sweeps(sweeps: Rows) -> tuple[ValidSweeps, tuple[str, ...]]:
    """Separate valid tools from rejected ones.

    Args:
        sweeps: SWEEP rows of one tick; the rows of a tool in the order of its pairs.

    Returns:
        (valid sweeps, a message for each rejected tool).
    """
    rows = sweeps
    points, first_row, faults, are_valid, is_sorted = _parse_tools(rows)
    if not is_sorted:  # as they are from one machine
        rows = sweeps[np.lexsort((sweeps["tool"], sweeps["machine_id"]))]
        points, first_row, faults, are_valid, _ = _parse_tools(rows)
    if are_valid:
        return ValidSweeps(rows, points, first_row), ()
    rejected = tuple(
        f"machine {rows['machine_id'][first_row[n]]}, tool {rows['tool'][first_row[n]]} is"
        f" rejected: {_FAULT_MESSAGES[SweepFault(faults[n])]}"
        for n in np.flatnonzero(faults)
    )
    rows = rows[np.repeat(faults == 0, np.diff(first_row, append=rows.size))]
    points, first_row, *_ = _parse_tools(rows)
    return ValidSweeps(rows, points, first_row), rejected


def group_by_machine(sweeps: ValidSweeps) -> list[MachineSweeps]:
    """Return the sweeps of each machine, sorted by machine id."""
    groups = []
    start = 0
    while start < sweeps.rows.size:
        (points, has_plate), press_pairs, tools, machine_id, end = _split_machine(
            sweeps.rows, sweeps.points, start
        )
        cuts = [
            _cut_sweep(sweeps.rows[row], SweptPairs(points[first:after], has_plate[first:after]))
            for row, first, after in tools.tolist()
        ]
        rows = sweeps.rows[start:end]
        groups.append(MachineSweeps(machine_id, rows, cuts, SweptPairs(*press_pairs)))
        start = end
    return groups


def _cut_sweep(first: np.void, pairs: SweptPairs) -> CutSweep:
    """Return the sweep of a tool from its first row and its pairs."""
    values = first.item()  # one conversion: each field of a record takes as long
    work = values[_WORK_FIELD] if values[_ACTION_FIELD] == _MILL else None
    return CutSweep(pairs, values[_ROOM_FIELD], values[_MACHINE_FIELD], values[_TOOL_FIELD], work)


@kernel
def positions_of_first_tools(rows):  # type: ignore[no-untyped-def]
    """Return the end positions of pair 0 of tool 0 of each machine, in the order of the rows.

    Args:
        rows: SWEEP rows, not validated: positions that are not finite are left out.

    Returns:
        Machine id and position at the end of the tick x, y, z [m], shape (n, 4).
    """
    positions = np.empty((rows.size, 4))
    count = 0
    for n in range(rows.size):
        row = rows[n]
        is_finite = np.isfinite(row.x1) and np.isfinite(row.y1) and np.isfinite(row.z1)
        if row.pair == 0 and row.tool == 0 and is_finite:
            positions[count, 0] = row.machine_id
            positions[count, 1], positions[count, 2] = row.x1, row.y1
            positions[count, 3] = row.z1
            count += 1
    return positions[:count]


@helper(inline="always")
def interpolate_key_point(points, which, t):  # type: ignore[no-untyped-def]
    """Return the position (x, y, z) of a key point (pair, end) at a fraction t of the tick.

    `points` are those of `SweptPairs`.
    """
    n, p = which
    return (
        (1 - t) * points[n, 0, p, 0] + t * points[n, 1, p, 0],
        (1 - t) * points[n, 0, p, 1] + t * points[n, 1, p, 1],
        (1 - t) * points[n, 0, p, 2] + t * points[n, 1, p, 2],
    )


@helper
def _is_sorted(rows):  # type: ignore[no-untyped-def]
    """Return whether SWEEP rows are sorted by machine and tool."""
    for n in range(1, rows.size):
        row, previous = rows[n], rows[n - 1]
        if row.machine_id < previous.machine_id or (
            row.machine_id == previous.machine_id and row.tool < previous.tool
        ):
            return False
    return True


@kernel
def _parse_tools(rows):  # type: ignore[no-untyped-def]
    """Return key points, first rows and faults of tools.

    Args:
        rows: SWEEP rows.

    Returns:
        (points and first rows as in `ValidSweeps`, `SweepFault` of each tool, shape (tools,),
        whether no tool has a fault, whether the rows are sorted by machine and tool: the others are
        of use only then).
    """
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
    are_valid = True
    for n in range(tools):
        end = first_row[n + 1] if n + 1 < tools else rows.size
        faults[n] = _find_fault(rows, points, first_row[n], end)
        are_valid = are_valid and faults[n] == _NO_FAULT
    return points, first_row, faults, are_valid, _is_sorted(rows)


@helper
def _find_fault(rows, points, first_row, end):  # type: ignore[no-untyped-def]
    """Return the first `SweepFault` of the rows `first_row` to `end` of one tool."""
    if (end - first_row) % 2 == 1:
        return _PAIR_ORDER
    for n in range(first_row, end):
        index = n - first_row
        if rows[n].pair != index // 2:
            return _PAIR_ORDER
        action, first_action = rows[n].action, rows[first_row].action
        if action > _LAST_ACTION or action != rows[n - index % 2].action:
            return _ACTION
        if (action == _MILL) != (first_action == _MILL):
            return _ACTION
        max_work = MAX_MILLING_WORK if action == _MILL else 0.0
        if not 0.0 <= rows[n].work <= max_work or rows[n].work != rows[first_row].work:
            return _WORK
        if rows[n].room_mm3 != rows[first_row].room_mm3:
            return _ROOM
        distance_squared = 0.0
        for axis in range(3):
            start, stop = points[n, 0, axis], points[n, 1, axis]
            if not (abs(start) <= _MAX_COORDINATE and abs(stop) <= _MAX_COORDINATE):
                return _COORDINATE
            distance_squared += (stop - start) ** 2
        if distance_squared > _MAX_DISPLACEMENT**2:
            return _DISPLACEMENT
    for t in range(2):
        for axis in range(3):
            low = high = points[first_row, t, axis]
            for n in range(first_row, end):
                low, high = min(low, points[n, t, axis]), max(high, points[n, t, axis])
            if high - low > _MAX_TOOL_EXTENT:
                return _EXTENT
    return _NO_FAULT


@kernel
def _split_machine(rows, points, start):  # type: ignore[no-untyped-def]
    """Split the rows of the machine that begin at `start`.

    Returns:
        (pairs that cut, pairs that compact, tools of the pairs that cut, machine id, index after
        the last row); the pairs as plain tuples, which are converted to Python in half the time,
        and of each tool its first row, first pair and pair after the last, shape (tools, 3).
    """
    end = start
    while end < rows.size and rows[end].machine_id == rows[start].machine_id:
        end += 1
    # Typed values: Numba would compile `_select_pairs` once for each of two literals.
    no, yes = np.bool_(False), np.bool_(True)
    cut_pairs, left = _select_pairs(rows, points, start, end, no)
    press_pairs, _ = _select_pairs(rows, points, start, end, yes)
    return cut_pairs, press_pairs, _tools_of_pairs(rows, left), rows[start].machine_id, end


@helper
def _tools_of_pairs(rows, left):  # type: ignore[no-untyped-def]
    """Return the tools of pairs as `_split_machine`; `left` are the first rows of the pairs."""
    tools = np.empty((left.size, 3), dtype=np.int64)
    count = 0
    for k in range(left.size):
        if k == 0 or rows[left[k]].tool != rows[left[k - 1]].tool:
            tools[count, 0], tools[count, 1] = left[k], k
            count += 1
        tools[count - 1, 2] = k + 1
    return tools[:count]


@helper
def _select_pairs(rows, points, start, end, compacting):  # type: ignore[no-untyped-def]
    """Return the pairs of the rows `start` to `end` that compact, or else those that do not.

    Returns:
        (the pairs, index of the first row of each).
    """
    left = np.empty((end - start) // 2, dtype=np.int64)  # index of the first row of each pair
    count = 0
    for n in range(start, end, 2):
        if (rows[n].action == _COMPACT) == compacting:
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
            row, previous = rows[left[k]], rows[left[k - 1]]
            has_plate[k - 1] = row.tool == previous.tool and row.pair == previous.pair + 1
    return (ends, has_plate), left[:count].copy()
