"""Before a step: which particles wake because something disturbs them, and which rows then move."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.sleep.apparent_gravity import has_changed, update_gravity
from machine_sim.dem.sleep.sleep_state import (
    AWAKE,
    is_loaded,
    locked_tool,
    select_moving_rows,
    wake,
)
from machine_sim.dem.sleep.wake_conditions import (
    load_approaches_soil,
    wake_in_spheres,
    wake_near_moving_tools,
    wake_on_changed_ground,
)
from machine_sim.dem.tools.pose import is_moving
from msg_bridge.kernels import helper

__all__ = ["wake_disturbed"]


@helper(allocates=True)
def wake_disturbed(  # type: ignore[no-untyped-def]
    dt, params, particles, tools, gravity, spheres, ground_changed, ground, moving_rows,
    locked_tools,
):  # fmt: skip
    """Wake the particles that are disturbed in the step to come, and select the rows that move.

    Args:
        dt: length of the step [s].
        params: `SleepParams`.
        particles: `ParticleColumns`; particles that wake keep the velocity of their carrier.
        tools: `ToolMotion` of the step, which has begun.
        gravity: `GravityInTools`, updated.
        spheres: particles that reach into these wake [m], map frame, shape (n, WAKE_SPHERE_SIZE).
        ground_changed: whether any column of the terrain changed since the last step.
        ground: `GroundData`; the marks of changed columns are cleared.
        moving_rows, locked_tools: out, rows and tools of `MovingRows`, with room for all particles.

    Returns:
        (number of particles that woke; numbers of rows that move by forces, and that are locked).
    """
    update_gravity(tools, params.gravity, dt, gravity)
    num_woken, rows = 0, _sleeping_rows(particles.sleep_state)
    if rows.size > 0:
        woken = np.zeros(rows.size, np.bool_)
        if spheres.shape[0] > 0:
            wake_in_spheres(rows, particles, spheres, woken)
        if ground_changed:
            wake_on_changed_ground(rows, particles, ground.changed, ground.frame, woken)
        wake_load = _wake_by_tools(dt, rows, params, particles, tools, gravity, woken)
        for k in range(rows.size):
            i = rows[k]
            tool = locked_tool(particles.sleep_state[i])
            if woken[k] or (tool >= 0 and wake_load[tool]):
                wake(i, particles)
                num_woken += 1
    if ground_changed:
        ground.changed[:] = False
    num_free, num_locked = select_moving_rows(
        particles.sleep_state, particles.frozen, moving_rows, locked_tools
    )
    return num_woken, num_free, num_locked


@helper(allocates=True)
def _sleeping_rows(sleep_state):  # type: ignore[no-untyped-def]
    """Return the rows of particles that are not awake."""
    rows, count = np.empty(sleep_state.size, np.int64), 0
    for i in range(sleep_state.size):
        rows[count] = i
        count += sleep_state[i] != AWAKE
    return rows[:count]


@helper(allocates=True)
def _wake_by_tools(dt, rows, params, particles, tools, gravity, woken):  # type: ignore[no-untyped-def]
    """Mark the particles that moving tools disturb in `woken`, marks of `rows`.

    Returns:
        Which tools lose their locked load, shape (tools,).
    """
    num_tools = tools.twist.shape[0]
    wake_load, moves = np.empty(num_tools, np.bool_), np.empty(num_tools, np.bool_)
    for t in range(num_tools):
        wake_load[t] = has_changed(gravity, t, params.wake_gravity_change)
        moves[t] = is_moving(tools.twist[t])
    if not moves.any():
        return wake_load
    wake_near_moving_tools(dt, rows, particles, moves, tools, woken, wake_load)
    for t in range(num_tools):
        if moves[t] and not wake_load[t] and is_loaded(t, particles.sleep_state):
            wake_load[t] = load_approaches_soil(dt, t, tools, rows, particles, woken)
    return wake_load
