"""Sweeps as they come: which tools' rows are sound, and the key-point pairs that cut or press.

Rows come from outside. They are judged before anything is moved, and a tool is believed whole or
not at all: half a tool would cut a shape nobody has.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from msg_bridge.contract.rows import Action, Rows

__all__ = ["SweptPairs", "first_of_tools", "pairs_that", "sound_sweeps"]

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


class SweptPairs(NamedTuple):
    """The key-point pairs of one source that cut, or press, over a tick.

    Attributes:
        points: start and end of the tick, left and right end [m], map frame, shape (n, 2, 2, 3).
        joined: whether a plate spans pair k and pair k + 1, shape (n,).
    """

    points: NDArray[np.float64]
    joined: NDArray[np.bool_]


def sound_sweeps(sweeps: Rows) -> tuple[Rows, tuple[str, ...]]:
    """The rows of the tools that can be believed, and what is wrong with the others.

    Args:
        sweeps: SWEEP rows of one tick; a tool's rows in the order of its pairs.

    Returns:
        (rows by source and tool, a sentence for each tool left out).
    """
    if sweeps.size == 0:
        return sweeps, ()
    sweeps = sweeps[np.lexsort((sweeps["tool"], sweeps["source"]))]
    source, tool = sweeps["source"], sweeps["tool"]
    first = first_of_tools(sweeps)
    faults = _faults(_key_points(sweeps), sweeps["pair"], sweeps["action"], first)
    if not faults.any():
        return sweeps, ()
    refused = tuple(
        f"source {source[first[n]]}, tool {tool[first[n]]} swept nothing: {_FAULTS[faults[n]]}"
        for n in np.flatnonzero(faults)
    )
    return sweeps[np.repeat(faults == 0, np.diff(first, append=sweeps.size))], refused


def first_of_tools(sweeps: Rows) -> NDArray[np.intp]:
    """Index of each tool's first row; `sweeps` by source and tool."""
    first = np.ones(sweeps.size, dtype=np.bool_)
    source, tool = sweeps["source"], sweeps["tool"]
    first[1:] = (source[1:] != source[:-1]) | (tool[1:] != tool[:-1])
    return np.flatnonzero(first)


def pairs_that(sweeps: Rows, *actions: Action) -> SweptPairs:
    """The pairs that cut, or those that press, and how they are joined.

    Args:
        sweeps: sound SWEEP rows of one source, by tool.
        actions: which of them.
    """
    rows = sweeps[np.isin(sweeps["action"], actions)]
    points = _key_points(rows).reshape(-1, 2, 2, 3).swapaxes(1, 2)
    tool, pair = rows["tool"][::2], rows["pair"][::2].astype(np.int64)
    joined = np.zeros(tool.size, dtype=np.bool_)
    joined[:-1] = (tool[:-1] == tool[1:]) & (pair[:-1] + 1 == pair[1:])
    return SweptPairs(np.ascontiguousarray(points), joined)


def _key_points(sweeps: Rows) -> NDArray[np.float64]:
    """Start and end of each row's key point [m], shape (rows, 2, 3)."""
    axes = [sweeps[name] for name in ("x0", "y0", "z0", "x1", "y1", "z1")]
    return np.stack(axes, axis=-1).astype(np.float64).reshape(-1, 2, 3)


@njit(cache=True)
def _faults(points, pair, action, first):  # type: ignore[no-untyped-def]
    """The fault of each tool, an index into `_FAULTS`; tools start at `first`."""
    faults = np.zeros(first.size, dtype=np.int64)
    for n in range(first.size):
        end = first[n + 1] if n + 1 < first.size else pair.size
        own = slice(first[n], end)
        faults[n] = _fault(points[own], pair[own], action[own])
    return faults


@njit(cache=True)
def _fault(points, pair, action):  # type: ignore[no-untyped-def]
    """The first fault found in one tool's rows; 0 for a sound tool."""
    if pair.size % 2 == 1:
        return 1
    for n in range(pair.size):
        if pair[n] != n // 2:
            return 1
        if action[n] > 2 or action[n] != action[n - n % 2]:
            return 2
        for t in range(2):
            for axis in range(3):
                if not abs(points[n, t, axis]) <= _FARTHEST:
                    return 3
        if ((points[n, 1] - points[n, 0]) ** 2).sum() > _LONGEST_WAY**2:
            return 5
    for t in range(2):
        for axis in range(3):
            if np.ptp(points[:, t, axis]) > _LARGEST_TOOL:
                return 4
    return 0
