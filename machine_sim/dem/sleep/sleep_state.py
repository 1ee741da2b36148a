"""Sleep states of particles, and the columns of the state that the sleep kernels use."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from machine_sim.dem.state import ASLEEP_ON_MAP, AWAKE
from msg_bridge.kernels import kernel

__all__ = [
    "ASLEEP_ON_MAP",
    "AWAKE",
    "FIRST_LOCKED_TOOL",
    "SleepView",
    "locked_state",
    "locked_tool",
    "mark_loaded_tools",
    "select_moving_rows",
]

FIRST_LOCKED_TOOL = 2
"""Sleep state of a particle that is locked to tool 0; tool t has FIRST_LOCKED_TOOL + t."""


@register_jitable
def locked_tool(sleep_state: Any) -> Any:
    """Return the index of the tool that a sleep state is locked to, negative for none."""
    return sleep_state - FIRST_LOCKED_TOOL


@register_jitable
def locked_state(tool: Any) -> Any:
    """Return the sleep state of a particle that is locked to the tool of an index."""
    return tool + FIRST_LOCKED_TOOL


class SleepView(NamedTuple):
    """Columns of `ParticleState` that the sleep kernels read or write; see there for the units."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    angular_velocity: NDArray[np.float32]
    radius: NDArray[np.float32]
    contact_radius: NDArray[np.float32]
    frozen: NDArray[np.bool_]
    sleep_state: NDArray[np.int16]
    sleep_timer: NDArray[np.float32]
    wake_reference: NDArray[np.float64]


@kernel
def select_moving_rows(sleep_state, frozen):  # type: ignore[no-untyped-def]
    """Split the rows of particles that move.

    Returns:
        Rows that move by forces, rows that are locked to a tool, and the tool index of each of
        the latter, int64.
    """
    rows, locked_rows = np.empty(sleep_state.size, np.int64), np.empty(sleep_state.size, np.int64)
    tools = np.empty(sleep_state.size, np.int64)
    num_free, num_locked = 0, 0
    for i in range(sleep_state.size):
        rows[num_free] = i
        num_free += sleep_state[i] == AWAKE and not frozen[i]
        locked_rows[num_locked], tools[num_locked] = i, locked_tool(sleep_state[i])
        num_locked += sleep_state[i] >= FIRST_LOCKED_TOOL
    return rows[:num_free], locked_rows[:num_locked], tools[:num_locked]


@kernel
def mark_loaded_tools(rows, sleep_state, has_load):  # type: ignore[no-untyped-def]
    """Mark in `has_load`, by tool index, the tools that some of `rows` are locked to."""
    for i in rows:
        tool = locked_tool(sleep_state[i])
        if tool >= 0:
            has_load[tool] = True
