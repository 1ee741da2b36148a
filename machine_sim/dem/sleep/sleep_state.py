"""Sleep states of particles, and the rows that move by them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from machine_sim.dem.params import ParticleParams
from machine_sim.dem.state import ASLEEP_ON_MAP, AWAKE
from msg_bridge.kernels import fixed_signature_kernel, helper

__all__ = [
    "ASLEEP_ON_MAP",
    "AWAKE",
    "FIRST_LOCKED_TOOL",
    "MovingRows",
    "SleepParams",
    "is_loaded",
    "locked_state",
    "locked_tool",
    "select_moving_rows",
    "wake",
    "wake_rows",
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


class MovingRows(NamedTuple):
    """Rows that move in a step.

    Attributes:
        all: rows that move by forces, then rows that are locked to a tool.
        num_free: number of rows that move by forces.
        locked_tool: tool index of each locked row.
    """

    all: NDArray[np.int64]
    num_free: int
    locked_tool: NDArray[np.int64]


class SleepParams(NamedTuple):
    """Parameters of sleep, for kernels.

    Attributes:
        gravity: acceleration of gravity, downward [m/s^2].
        wake_gravity_change: change of the apparent gravity in a tool that wakes its load [m/s^2].
        wake_speed: speed of a particle that wakes a locked one that it touches [m/s].
        sleep_speed, sleep_time: speed below which a particle falls asleep [m/s] after a time [s].
        allow_sleeping, allow_load_locking: whether particles sleep, and are locked to tools.
    """

    gravity: float
    wake_gravity_change: float
    wake_speed: float
    sleep_speed: float
    sleep_time: float
    allow_sleeping: bool
    allow_load_locking: bool

    @classmethod
    def of(cls, params: ParticleParams) -> SleepParams:
        """Return those of an engine."""
        return cls(
            gravity=params.gravity,
            wake_gravity_change=params.wake_gravity_change * params.gravity,
            wake_speed=params.wake_speed,
            sleep_speed=params.sleep_speed,
            sleep_time=params.sleep_time,
            allow_sleeping=params.allow_sleeping,
            allow_load_locking=params.allow_load_locking,
        )


@helper(allocates=True)
def is_loaded(tool, sleep_state):  # type: ignore[no-untyped-def]
    """Return whether any particle is locked to a tool."""
    return (sleep_state == locked_state(tool)).any()


@helper(forceinline=True)
def wake(row, particles):  # type: ignore[no-untyped-def]
    """Wake a particle of a `ParticleColumns`; it keeps the velocity of its carrier."""
    particles.sleep_state[row] = AWAKE
    particles.sleep_timer[row] = np.float32(0.0)
    for axis in range(3):
        particles.wake_reference[row, axis] = particles.position[row, axis]


@fixed_signature_kernel
def wake_rows(rows, boxed_particles):  # type: ignore[no-untyped-def]
    """Wake rows of a `ParticleColumns`; they keep the velocity of their carrier."""
    for i in rows:
        wake(i, boxed_particles.table)


@helper
def select_moving_rows(sleep_state, frozen, rows, tools):  # type: ignore[no-untyped-def]
    """Fill in the rows and tools of the `MovingRows` of some columns.

    Returns:
        Numbers of rows that move by forces, and that are locked to a tool.
    """
    n = sleep_state.size
    num_free, num_locked = 0, 0
    for i in range(n):
        rows[num_free] = i
        num_free += sleep_state[i] == AWAKE and not frozen[i]
    for i in range(n):
        if sleep_state[i] >= FIRST_LOCKED_TOOL:
            rows[num_free + num_locked] = i
            tools[num_locked] = locked_tool(sleep_state[i])
            num_locked += 1
    return num_free, num_locked
