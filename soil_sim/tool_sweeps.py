"""Tool sweeps of a tick, by machine: the key-point pairs that cut and those that compact.

The rows are validated by `sweep_validation` before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import Rows, SweepAction
from msg_bridge.kernels import fixed_signature_kernel, helper, kernel

__all__ = [
    "CutSweep",
    "MachineSweeps",
    "SweptPairs",
    "ValidSweeps",
    "group_by_machine",
    "interpolate_key_point",
    "positions_of_first_tools",
    "pressed_pairs",
]

_COMPACT, _MILL = int(SweepAction.COMPACT), int(SweepAction.MILL)

_CUTTING_TOOL = np.dtype(
    [
        ("first", np.int64),  # pairs of the tool among those of its machine: first, after the last
        ("end", np.int64),
        ("room_mm3", np.int64),
        ("tool", np.int64),
        ("mills", np.bool_),
        ("work", np.float64),  # [J]
    ]
)
"""What `CutSweep` states of a tool, in this order."""


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
    """Key-point pairs of one machine that cut in a tick.

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
        rows, points: its SWEEP rows and their key points, as of `ValidSweeps`.
        cuts: the pairs that cut or mill, by tool.
        compacts: whether there are pairs that compact.
    """

    machine_id: int
    rows: Rows
    points: NDArray[np.float64]
    cuts: list[CutSweep]
    compacts: bool


def group_by_machine(sweeps: ValidSweeps) -> list[MachineSweeps]:
    """Return the sweeps of each machine, sorted by machine id."""
    rows, points, _ = sweeps
    groups = []
    start = 0
    while start < rows.size:
        # Arrays that a kernel makes take several times as long to return.
        max_pairs = (rows.size - start) // 2
        ends, has_plate = np.empty((max_pairs, 2, 2, 3)), np.empty(max_pairs, np.bool_)
        tools = np.empty(max_pairs, _CUTTING_TOOL)
        num_tools, machine_id, end = _cutting_tools(rows, points, start, ends, has_plate, tools)
        cutting = tools[:num_tools].tolist()
        cuts = [
            CutSweep(
                SweptPairs(ends[first:after], has_plate[first:after]),
                room,
                machine_id,
                tool,
                work if mills else None,
            )
            for first, after, room, tool, mills, work in cutting
        ]
        num_cutting = cutting[-1][1] if cutting else 0
        compacts = num_cutting < (end - start) // 2
        own = rows[start:end], points[start:end]
        groups.append(MachineSweeps(machine_id, *own, cuts, compacts))
        start = end
    return groups


def positions_of_first_tools(rows: Rows) -> NDArray[np.float64]:
    """Return the end positions of pair 0 of tool 0 of each machine, in the order of the rows.

    Args:
        rows: contiguous SWEEP rows, not validated: positions that are not finite are left out.

    Returns:
        Machine id and position at the end of the tick x, y, z [m], shape (n, 4).
    """
    positions = np.empty((rows.size, 4))
    return positions[: _list_first_tools(rows, positions)]


@fixed_signature_kernel
def _list_first_tools(rows, positions):  # type: ignore[no-untyped-def]
    """Write the result of `positions_of_first_tools`, and return its length."""
    count = 0
    for n in range(rows.size):
        row = rows[n]
        is_finite = np.isfinite(row.x1) and np.isfinite(row.y1) and np.isfinite(row.z1)
        if row.pair == 0 and row.tool == 0 and is_finite:
            positions[count, 0] = row.machine_id
            positions[count, 1], positions[count, 2] = row.x1, row.y1
            positions[count, 3] = row.z1
            count += 1
    return count


@helper(forceinline=True)
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


@fixed_signature_kernel
def _cutting_tools(rows, points, start, ends, has_plate, tools):  # type: ignore[no-untyped-def]
    """List the pairs that cut or mill of the machine whose rows begin at `start`.

    Args:
        rows, points: as of `ValidSweeps`.
        start: index of the first row of the machine.
        ends, has_plate: out, points and plates of all of its pairs as `SweptPairs`.
        tools: out, `_CUTTING_TOOL` records.

    Returns:
        (number of tools, machine id, index after its last row).
    """
    end = start
    while end < rows.size and rows[end].machine_id == rows[start].machine_id:
        end += 1
    left = _select_pairs(rows, start, end, np.bool_(False))
    _copy_pairs(rows, points, left, ends, has_plate)
    return _list_tools(rows, left, tools), rows[start].machine_id, end


@kernel
def pressed_pairs(rows, points):  # type: ignore[no-untyped-def]
    """Return the pairs of one machine that compact.

    Args:
        rows, points: those of its `MachineSweeps`.

    Returns:
        (points and plates as `SweptPairs`; pressure on the ground at the left and the right end of
        each pair [Pa], shape (pairs, 2), float64; id of the tool of each pair, shape (pairs,),
        int64).
    """
    left = _select_pairs(rows, 0, rows.size, np.bool_(True))
    ends, has_plate = np.empty((left.size, 2, 2, 3)), np.empty(left.size, dtype=np.bool_)
    _copy_pairs(rows, points, left, ends, has_plate)
    pressure, tool = np.empty((left.size, 2)), np.empty(left.size, dtype=np.int64)
    for k in range(left.size):
        tool[k] = rows[left[k]].tool
        for side in range(2):
            pressure[k, side] = rows[left[k] + side].pressure
    return ends, has_plate, pressure, tool


@helper
def _list_tools(rows, left, tools):  # type: ignore[no-untyped-def]
    """Write the `_CUTTING_TOOL` records of pairs, whose first rows are `left`; return the number of
    tools."""
    count = 0
    for k in range(left.size):
        row = rows[left[k]]
        if k == 0 or row.tool != rows[left[k - 1]].tool:
            tool = tools[count]
            tool.first, tool.tool, tool.room_mm3 = k, row.tool, row.room_mm3
            tool.mills, tool.work = row.action == _MILL, row.work
            count += 1
        tools[count - 1].end = k + 1
    return count


@helper(allocates=True)
def _select_pairs(rows, start, end, compacting):  # type: ignore[no-untyped-def]
    """Return the first row of each pair of the rows `start` to `end` that compacts, or of each that
    does not."""
    left = np.empty((end - start) // 2, dtype=np.int64)
    count = 0
    for n in range(start, end, 2):
        if (rows[n].action == _COMPACT) == compacting:
            left[count] = n
            count += 1
    return left[:count]


@helper
def _copy_pairs(rows, points, left, ends, has_plate):  # type: ignore[no-untyped-def]
    """Write the points and plates of pairs as `SweptPairs`; `left` are their first rows."""
    has_plate[: left.size] = False
    for k in range(left.size):
        for t in range(2):
            for side in range(2):
                for axis in range(3):
                    ends[k, t, side, axis] = points[left[k] + side, t, axis]
        if k > 0:
            row, previous = rows[left[k]], rows[left[k - 1]]
            has_plate[k - 1] = row.tool == previous.tool and row.pair == previous.pair + 1
