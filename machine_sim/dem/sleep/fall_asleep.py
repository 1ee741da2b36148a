"""After a step: which sleeping particles are touched awake, and which awake ones fall asleep."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.sleep.sleep_state import (
    ASLEEP_ON_MAP,
    FIRST_LOCKED_TOOL,
    is_loaded,
    locked_state,
)
from machine_sim.dem.sleep.sleep_timers import update_sleep_timers
from machine_sim.dem.sleep.support import trace_support
from machine_sim.dem.sleep.wake_conditions import wake_touching
from machine_sim.dem.tools.pose import is_moving
from msg_bridge.kernels import helper

__all__ = ["update_sleep"]

_MIN_LOCKED_FRACTION = 0.95
"""Minimum fraction of the particles in a tool that can be locked, else none is locked."""


@helper(allocates=True)
def update_sleep(dt, params, rows, inside, particles, tools, gravity, contacts):  # type: ignore[no-untyped-def]
    """Wake particles that moving ones touch, and put those to sleep that have rested long enough.

    Args:
        dt: length of the step [s].
        params: `SleepParams`.
        rows: rows that moved by forces in the step.
        inside: tool in whose hull each of them is.
        particles: `ParticleColumns`; those that fall asleep are at rest on their carriers.
        tools: `ToolMotion` at the end of the step.
        gravity: `GravityInTools`; the first soil of a load defines the gravity under which the load
            is at rest.
        contacts: `StepContacts`.

    Returns:
        (number of particles that woke; number that fell asleep; number of these that were locked
        to a tool, whose wake references are still to be set).
    """
    num_woken = 0
    if rows.size < particles.sleep_state.size:
        num_woken = wake_touching(rows, contacts.pair_contacts, particles, params.wake_speed)
    ready, sleep_state = np.zeros(rows.size, np.bool_), np.full(rows.size, ASLEEP_ON_MAP)
    if params.allow_sleeping and update_sleep_timers(
        rows, inside, particles, tools.path[-1], tools.twist, params.sleep_speed,
        params.sleep_time, dt, ready,
    ):  # fmt: skip
        for t in range(tools.twist.shape[0]):
            _classify_load(
                t, params, rows, inside, particles, tools, gravity, contacts, ready, sleep_state
            )
    num_asleep, num_locked = _set_asleep(rows, ready, sleep_state, particles)
    return num_woken, num_asleep, num_locked


@helper(allocates=True)
def _classify_load(  # type: ignore[no-untyped-def]
    t, params, rows, inside, particles, tools, gravity, contacts, ready, sleep_state
):
    """Find which particles that may fall asleep are locked to tool `t`, and which stay awake.

    Soil in a tool must weigh on the tool. So it is locked or stays awake, but does not sleep on the
    map. Soil that leans on something else too may sleep on the map, outside the tool or in a tool
    at rest.

    Args:
        ready: which of `rows` may fall asleep; cleared for those that stay awake.
        sleep_state: sleep states of `rows`; set for those that are locked.
        t, params, rows, inside, particles, tools, gravity, contacts: see `update_sleep`.
    """
    has_load = is_loaded(t, particles.sleep_state)
    if not has_load and not _may_hold_load(t, ready, inside, tools, contacts.plate_contacts):
        return
    on_tool, on_other = np.zeros(rows.size, np.bool_), np.zeros(rows.size, np.bool_)
    trace_support(t, rows, ready, particles, contacts, tools, on_tool, on_other)
    moves = is_moving(tools.twist[t])
    stays_awake, locks = np.empty(rows.size, np.bool_), np.empty(rows.size, np.bool_)
    num_inside, num_locks, num_locks_inside = 0, 0, 0
    for k in range(rows.size):
        is_inside = inside[k] == t
        stays_awake[k] = is_inside and ready[k] and (moves or not on_other[k])
        if tools.is_digging[t] or moves:
            stays_awake[k] |= on_tool[k] and (is_inside or not on_other[k])
        locks[k] = on_tool[k] and not on_other[k]
        num_inside += is_inside
        num_locks += locks[k]
        num_locks_inside += locks[k] and is_inside
    is_lockable = num_locks > 0 and num_locks_inside >= _MIN_LOCKED_FRACTION * num_inside
    may_lock = params.allow_load_locking and (has_load or is_lockable)
    if may_lock and not has_load:
        gravity.at_lock[t] = gravity.current[t]
    for k in range(rows.size):
        if locks[k] and may_lock:
            sleep_state[k] = locked_state(t)
        elif locks[k] or stays_awake[k]:
            ready[k] = False


@helper(allocates=True)
def _may_hold_load(tool, ready, inside, tools, plate_contacts):  # type: ignore[no-untyped-def]
    """Return whether a particle that may fall asleep is in a tool, or any is near its plates."""
    for k in range(ready.size):
        if ready[k] and inside[k] == tool:
            return True
    return (tools.tool_of_plate[plate_contacts.plate] == tool).any()


@helper
def _set_asleep(rows, falls_asleep, sleep_state, particles):  # type: ignore[no-untyped-def]
    """Put `rows` into their sleep states, at rest.

    Returns:
        Number of rows that fell asleep, and number of these that were locked to a tool.
    """
    num_asleep, num_locked = 0, 0
    for k in range(rows.size):
        if not falls_asleep[k]:
            continue
        i = rows[k]
        num_asleep += 1
        particles.sleep_state[i] = sleep_state[k]
        is_locked = sleep_state[k] >= FIRST_LOCKED_TOOL
        num_locked += is_locked
        for axis in range(3):
            particles.angular_velocity[i, axis] = np.float32(0.0)
            if not is_locked:
                particles.velocity[i, axis] = 0.0
    return num_asleep, num_locked
