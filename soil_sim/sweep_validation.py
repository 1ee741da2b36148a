"""Validation of tool sweeps.

SWEEP rows come from outside. They are validated before any soil moves, and a tool is accepted or
rejected as a whole: half of the rows would cut a shape that no tool has.

The checks are of one tick and hold for any tool: order of the rows, actions, and values that the
kernels can process. `sweep_limits` checks before them what depends on the machine and on the ticks
before: `max_tool_speed`, the continuity of the motion, and that a tool keeps its shape.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import MAX_MILLING_WORK, MAX_PRESSURE, Rows, SweepAction
from msg_bridge.kernels import fixed_signature_kernel, helper
from soil_sim.tool_sweeps import ValidSweeps

__all__ = ["validate_sweeps"]

_MAX_COORDINATE = 1e5
"""Largest coordinate of a key point [m]; a float32 still resolves a centimetre there."""

_MAX_DISPLACEMENT = 20.0
"""Largest displacement of a key point in a tick [m]; at 10 ms that is 2000 m/s."""

_MAX_TOOL_EXTENT = 50.0
"""Largest extent of a tool along an axis [m]; the widest blades and buckets are below 25 m."""


_MAX_SWEPT_AREA = 50.0
"""Largest product of width and displacement of a tool in a tick [m^2]: the widest blade at 200 m/s.
The time that a sweep takes to compute grows with it."""


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
    PRESSURE = 8
    AREA = 9


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
    SweepFault.AREA: f"it sweeps more than {_MAX_SWEPT_AREA:g} m2 in a tick, its width times its"
    " displacement; send smaller motions",
    SweepFault.WORK: f"its work is not between 0 and {MAX_MILLING_WORK:g} J, differs from row to"
    " row, or is not 0 although it does not mill; send the work that the drum can deliver in the"
    " tick",
    SweepFault.PRESSURE: f"a pressure is not between 0 and {MAX_PRESSURE:g} Pa, or is not 0"
    " although its pair does not compact; send the pressure on the ground at the key point",
}
"""What is wrong with the rows and what to change."""

_NO_FAULT, _PAIR_ORDER, _ACTION, _ROOM = (
    int(SweepFault.NONE),
    int(SweepFault.PAIR_ORDER),
    int(SweepFault.ACTION),
    int(SweepFault.ROOM),
)
_COORDINATE, _EXTENT, _DISPLACEMENT, _WORK, _PRESSURE, _AREA = (
    int(SweepFault.COORDINATE),
    int(SweepFault.EXTENT),
    int(SweepFault.DISPLACEMENT),
    int(SweepFault.WORK),
    int(SweepFault.PRESSURE),
    int(SweepFault.AREA),
)
_COMPACT, _MILL = int(SweepAction.COMPACT), int(SweepAction.MILL)
_LAST_ACTION = int(max(SweepAction))


def validate_sweeps(sweeps: Rows) -> tuple[ValidSweeps, tuple[str, ...]]:
    """Separate valid tools from rejected ones.

    Args:
        sweeps: contiguous SWEEP rows of one tick; the rows of a tool in the order of its pairs.

    Returns:
        (valid sweeps, a message for each rejected tool).
    """
    parsed, faults, is_sorted = _parse(sweeps)
    if not is_sorted:  # as they are from one machine
        parsed, faults, _ = _parse(sweeps[np.lexsort((sweeps["tool"], sweeps["machine_id"]))])
    rows, _, first_row = parsed
    if faults.size == 0:
        return parsed, ()
    rejected = tuple(
        f"machine {rows['machine_id'][first_row[n]]}, tool {rows['tool'][first_row[n]]} is"
        f" rejected: {_FAULT_MESSAGES[SweepFault(faults[n])]}"
        for n in np.flatnonzero(faults)
    )
    valid, *_ = _parse(rows[np.repeat(faults == 0, np.diff(first_row, append=rows.size))])
    return valid, rejected


def _parse(rows: Rows) -> tuple[ValidSweeps, NDArray[np.int64], bool]:
    """Return key points, first rows and faults of tools.

    Args:
        rows: SWEEP rows.

    Returns:
        (rows, points and first rows; `SweepFault` of each tool, empty if none has a fault; whether
        the rows are sorted by machine and tool: the others are of use only then).
    """
    # Arrays that a kernel makes take several times as long to return.
    points = np.empty((rows.size, 2, 3))
    first_row, faults = np.empty((2, rows.size), dtype=np.int64)
    num_tools, are_valid, is_sorted = _parse_tools(rows, points, first_row, faults)
    sweeps = ValidSweeps(rows, points, first_row[:num_tools])
    return sweeps, faults[: 0 if are_valid else num_tools], is_sorted


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


@fixed_signature_kernel
def _parse_tools(rows, points, first_row, faults):  # type: ignore[no-untyped-def]
    """Parse rows as `_parse`.

    Args:
        rows: SWEEP rows.
        points, first_row: out, as in `ValidSweeps`; `first_row` has room for all rows.
        faults: out, `SweepFault` of each tool, with room for all rows.

    Returns:
        (number of tools, whether no tool has a fault, whether the rows are sorted).
    """
    tools = 0
    for n in range(rows.size):
        row = rows[n]
        points[n, 0, 0], points[n, 0, 1], points[n, 0, 2] = row.x0, row.y0, row.z0
        points[n, 1, 0], points[n, 1, 1], points[n, 1, 2] = row.x1, row.y1, row.z1
        if n == 0 or row.machine_id != rows[n - 1].machine_id or row.tool != rows[n - 1].tool:
            first_row[tools] = n
            tools += 1
    are_valid = True
    for n in range(tools):
        end = first_row[n + 1] if n + 1 < tools else rows.size
        faults[n] = _find_fault(rows, points, first_row[n], end)
        are_valid = are_valid and faults[n] == _NO_FAULT
    return tools, are_valid, _is_sorted(rows)


@helper
def _find_fault(rows, points, first_row, end):  # type: ignore[no-untyped-def]
    """Return the first `SweepFault` of the rows `first_row` to `end` of one tool."""
    if (end - first_row) % 2 == 1:
        return _PAIR_ORDER
    max_distance_squared = max_width_squared = 0.0
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
        max_pressure = MAX_PRESSURE if action == _COMPACT else 0.0
        if not 0.0 <= rows[n].pressure <= max_pressure:
            return _PRESSURE
        distance_squared = 0.0
        for axis in range(3):
            start, stop = points[n, 0, axis], points[n, 1, axis]
            if not (abs(start) <= _MAX_COORDINATE and abs(stop) <= _MAX_COORDINATE):
                return _COORDINATE
            distance_squared += (stop - start) ** 2
        if distance_squared > _MAX_DISPLACEMENT**2:
            return _DISPLACEMENT
        max_distance_squared = max(max_distance_squared, distance_squared)
    for n in range(first_row, end, 2):
        width_squared = 0.0
        for axis in range(3):
            width_squared += (points[n + 1, 1, axis] - points[n, 1, axis]) ** 2
        max_width_squared = max(max_width_squared, width_squared)
    if max_distance_squared * max_width_squared > _MAX_SWEPT_AREA**2:
        return _AREA
    for t in range(2):
        for axis in range(3):
            low = high = points[first_row, t, axis]
            for n in range(first_row, end):
                low, high = min(low, points[n, t, axis]), max(high, points[n, t, axis])
            if high - low > _MAX_TOOL_EXTENT:
                return _EXTENT
    return _NO_FAULT
