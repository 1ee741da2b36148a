"""Start of a step: poses of the tools, particles that wake, and whether the others can be moved.

    poses of the tools -> disturbed particles wake -> rows that move -> neighbour list -> room

`particle_step` calls it.
"""

from __future__ import annotations

import numpy as np

from machine_sim.dem.contacts import plate_block
from machine_sim.dem.neighbours.skin_widths import (
    GrowthPrediction,
    any_skin_exceeded,
    tracks_all_rows,
)
from machine_sim.dem.sleep.wake_disturbed import wake_disturbed
from machine_sim.dem.tools.tool_set import begin_tool_motion
from msg_bridge.kernels import helper, threaded_stages

__all__ = ["LIST_EXPIRED", "READY", "ROOM_TOO_SMALL", "ROWS_NOT_LISTED", "start_step"]

READY = 0
"""The particles can be moved."""
ROOM_TOO_SMALL = 1
"""Arrays for contacts are too small."""
ROWS_NOT_LISTED = 2
"""Particles that were added are to be inserted into the neighbour list."""
LIST_EXPIRED = 3
"""The neighbour list must be rebuilt."""


@threaded_stages
def start_step(  # type: ignore[no-untyped-def]
    dt, num_listed, ground_changed, spheres, listed, boxed_params, boxed_memory, boxed_particles,
    boxed_plates, boxed_plate_memory, boxed_ground, boxed_tools, boxed_gravity,
):  # fmt: skip
    """Wake the particles that are disturbed, and find what must be done before the others move.

    Args:
        dt: length of the step [s].
        num_listed: number of rows in the neighbour list, -1 if it must be rebuilt anyway.
        ground_changed, spheres: see `wake_disturbed`.
        listed: `ListedParticles`.
        boxed_params: `StepParams`, boxed, as the tables below.
        boxed_memory: `StepMemory`; the rows that move are filled.
        boxed_particles: `ParticleColumns`; see `wake_disturbed`.
        boxed_plates: `PlateContactArrays` to be filled in the step.
        boxed_plate_memory: `PlateContactMemory`.
        boxed_ground: `GroundData`.
        boxed_tools: `ToolMotion`; the step begins.
        boxed_gravity: `GravityInTools`, updated.

    Returns:
        (what must be done before particles move, `READY` for nothing; number of particles that
        woke; numbers of rows that move by forces, and that are locked).
    """
    params, memory, particles = boxed_params.table, boxed_memory.table, boxed_particles.table
    tools, ground = boxed_tools.table, boxed_ground.table
    begin_tool_motion(dt, tools)
    num_woken, num_free, num_locked = wake_disturbed(
        dt, params.sleep, particles, tools, boxed_gravity.table, spheres, ground_changed, ground,
        memory.moving_rows, memory.locked_tools,
    )  # fmt: skip
    count, num_moving, todo = particles.radius.size, num_free + num_locked, np.int64(READY)
    if num_free == 0:
        return todo, num_woken, num_free, num_locked
    # Pairs of two particles that sleep are not listed.
    if num_listed < 0 or num_woken > 0:
        todo = np.int64(LIST_EXPIRED)
    else:
        rows = memory.moving_rows[:num_moving]
        if tracks_all_rows(num_moving, count):
            rows = memory.all_rows[:num_listed]
        elif num_listed < count:
            rows = _rows_below(num_listed, rows)
        if rows.size > 0 and any_skin_exceeded(
            rows, rows.size == num_listed, particles, listed,
            GrowthPrediction(params.max_initial_radius, params.max_growth), dt,
        ):  # fmt: skip
            todo = np.int64(LIST_EXPIRED)
        elif num_listed < count:
            todo = np.int64(ROWS_NOT_LISTED)
        elif not _has_room(
            num_free, count, boxed_plates.table, boxed_plate_memory.table, ground, tools
        ):
            todo = np.int64(ROOM_TOO_SMALL)
    return todo, num_woken, num_free, num_locked


@helper(allocates=True)
def _rows_below(end, rows):  # type: ignore[no-untyped-def]
    """Return those of some rows that are below `end`."""
    below, count = np.empty(rows.size, np.int64), 0
    for i in rows:
        below[count] = i
        count += i < end
    return below[:count]


@helper
def _has_room(num_free, count, plates, plate_memory, ground, tools):  # type: ignore[no-untyped-def]
    """Return whether the contacts of `num_free` rows, of `count`, fit into the arrays for them.

    The number of contacts with plates is only known once they are listed: there is room for as many
    as the table can hold.
    """
    max_contacts = plates.row.size
    max_blocks = max_contacts // plate_block.BLOCK_SIZE + tools.tool_of_plate.size
    return (
        num_free <= ground.contacts.row.size
        and count <= plates.begin.size
        and max_contacts <= plate_memory.slot.size
        and max_blocks <= plate_memory.blocks.plate.size
    )
