"""Tool sweeps of a tick, by machine: the key-point pairs that cut and those that compact.

The rows are validated by `sweep_validation` before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import SWEEP, Rows, SweepAction
from msg_bridge.kernels import helper, kernel

__all__ = [
    "CutSweep",
    "MachineSweeps",
    "PressedPairs",
    "SweptPairs",
    "ValidSweeps",
    "group_by_machine",
    "interpolate_key_point",
    "positions_of_first_tools",
]

_COMPACT, _MILL = int(SweepAction.COMPACT), int(SweepAction.MILL)
_WORK_FIELD, _ACTION_FIELD, _ROOM_FIELD, _MACHINE_FIELD, _TOOL_FIELD = (
    SWEEP.names.index(name)  # type: ignore[union-attr]
    for name in ("work", "action", "room_mm3", "machine_id", "tool")
)


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


class PressedPairs(NamedTuple):
    """Key-point pairs of one machine that compact in a tick.

    Attributes:
        points, has_plate: as of `SweptPairs`.
        pressure: on the ground at the left and the right end of each pair [Pa], shape (pairs, 2),
            float64.
        tool: id of the tool of each pair, shape (pairs,), int64.
    """

    points: NDArray[np.float64]
    has_plate: NDArray[np.bool_]
    pressure: NDArray[np.float64]
    tool: NDArray[np.int64]


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
        pressed: the pairs that compact.
    """

    machine_id: int
    rows: Rows
    cuts: list[CutSweep]
    pressed: PressedPairs


def group_by_machine(sweeps: ValidSweeps) -> list[MachineSweeps]:
    """Return the sweeps of each machine, sorted by machine id."""
    groups = []
    start = 0
    while start < sweeps.rows.size:
        (points, has_plate), pressed, tools, machine_id, end = _split_machine(
            sweeps.rows, sweeps.points, start
        )
        cuts = [
            _cut_sweep(sweeps.rows[row], SweptPairs(points[first:after], has_plate[first:after]))
            for row, first, after in tools.tolist()
        ]
        rows = sweeps.rows[start:end]
        groups.append(MachineSweeps(machine_id, rows, cuts, PressedPairs(*pressed)))
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
    (pressing, has_plate), pressing_left = _select_pairs(rows, points, start, end, yes)
    pressed = (pressing, has_plate, *_pressures_of_pairs(rows, pressing_left))
    return cut_pairs, pressed, _tools_of_pairs(rows, left), rows[start].machine_id, end


@helper(allocates=True)
def _pressures_of_pairs(rows, left):  # type: ignore[no-untyped-def]
    """Return pressures and tools of pairs as `PressedPairs`.

    `left` are the first rows of the pairs.
    """
    pressure, tool = np.empty((left.size, 2)), np.empty(left.size, dtype=np.int64)
    for k in range(left.size):
        tool[k] = rows[left[k]].tool
        for side in range(2):
            pressure[k, side] = rows[left[k] + side].pressure
    return pressure, tool


@helper(allocates=True)
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


@helper(allocates=True)
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
