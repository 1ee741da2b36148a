"""A step of the particles in one call, from the poses of the tools to the wrenches on them.

    start -> [neighbour list] -> contacts, growth and motion -> locked loads -> sleep -> end

A step of a thousand particles takes a fraction of a millisecond; calling each stage from Python
would take as long again. In most steps nothing has to be done in Python: the list is not too old,
and no table too small. Where something has, the kernel returns after the start, and is entered
again for the motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from machine_sim.dem.contacts.ground_contacts import first_ground_contacts
from machine_sim.dem.contacts.plate_contact_list import PlateCandidates
from machine_sim.dem.contacts.step_contacts import StepContacts
from machine_sim.dem.sleep.fall_asleep import update_sleep
from machine_sim.dem.sleep.locked_load import move_locked_loads
from machine_sim.dem.sleep.sleep_state import MovingRows
from machine_sim.dem.step_motion import move_particles
from machine_sim.dem.step_start import READY, start_step
from machine_sim.dem.tools.tool_set import end_tool_motion
from msg_bridge.kernels import threaded_stages

__all__ = ["StepResult", "StepState", "advance_particles"]


class StepState(NamedTuple):
    """What has changed since the last step.

    Attributes:
        has_started: whether the step has started: its particles are to be moved.
        num_free, num_locked: of a step that has started, numbers of rows that move by forces, and
            that are locked to tools.
        num_listed: number of rows in the neighbour list, -1 if it must be rebuilt anyway.
        ground_changed: whether any column of the terrain has changed.
        loads_all: whether the body records of all particles are loaded, not of moving ones only.
        rebuilds_contacts: whether the pair contacts were cleared.
        grows: whether there may be contact radii below the full radius.
        sets_initial_radii: whether there may be contact radii of 0.
    """

    has_started: bool
    num_free: int
    num_locked: int
    num_listed: int
    ground_changed: bool
    loads_all: bool
    rebuilds_contacts: bool
    grows: bool
    sets_initial_radii: bool


class StepResult(NamedTuple):
    """What a call of `advance_particles` has done.

    Attributes:
        todo: what must be done before the particles are moved, see `step_start`; `READY` for
            nothing: then the step has ended.
        num_disturbed: number of particles that woke at the start.
        num_free, num_locked: numbers of rows that move by forces, and that are locked to tools.
        num_plate_contacts: number of contacts with plates, -1 where the table is too small: then
            the step has not ended.
        num_growing: number of particles that still grow.
        num_tunnelled: number that passed through a plate.
        num_recovered: number that were put back on the ground.
        num_woken, num_asleep: numbers that woke and fell asleep at the end.
        num_locking: number of the latter that were locked to a tool, whose wake references are
            still to be set.
    """

    todo: int
    num_disturbed: int
    num_free: int
    num_locked: int
    num_plate_contacts: int
    num_growing: int
    num_tunnelled: int
    num_recovered: int
    num_woken: int
    num_asleep: int
    num_locking: int


@threaded_stages
def advance_particles(  # type: ignore[no-untyped-def]
    dt, state, spheres, listed, boxed_params, boxed_memory, boxed_particles, boxed_list,
    boxed_pairs, boxed_old_plates, boxed_plates, boxed_plate_memory, boxed_ground, boxed_tools,
    boxed_gravity,
):  # fmt: skip
    """Advance all particles by one step, or find what must be done before they can move.

    Args:
        dt: length of the step [s].
        state: `StepState`.
        spheres: see `wake_disturbed`.
        listed: `ListedParticles`.
        boxed_params: `StepParams`, boxed, as the tables below.
        boxed_memory: `StepMemory`.
        boxed_particles: `ParticleColumns`; updated.
        boxed_list: `ListedPairs`.
        boxed_pairs: `PairContactData`, updated.
        boxed_old_plates, boxed_plates: `PlateContactArrays` of the last step, and of this one; the
            latter are filled.
        boxed_plate_memory: `PlateContactMemory`.
        boxed_ground: `GroundData`; the contacts are filled.
        boxed_tools: `ToolMotion`; the wrenches are those of the step.
        boxed_gravity: `GravityInTools`, updated.

    Returns:
        The fields of `StepResult`.
    """
    zero = np.int64(0)
    todo, num_disturbed = np.int64(READY), zero
    num_free, num_locked = state.num_free, state.num_locked
    num_plate_contacts, num_growing, num_tunnelled, num_recovered = zero, zero, zero, zero
    num_woken, num_asleep, num_locking = zero, zero, zero
    if not state.has_started:
        todo, num_disturbed, num_free, num_locked = start_step(
            dt, state.num_listed, state.ground_changed, spheres, listed, boxed_params,
            boxed_memory, boxed_particles, boxed_plates, boxed_plate_memory, boxed_ground,
            boxed_tools, boxed_gravity,
        )  # fmt: skip
    params, memory, tools = boxed_params.table, boxed_memory.table, boxed_tools.table
    particles, gravity = boxed_particles.table, boxed_gravity.table
    moving = MovingRows(
        memory.moving_rows[: num_free + num_locked], num_free, memory.locked_tools[:num_locked]
    )
    if todo == READY and num_free > 0:
        num_plate_contacts, num_ground_contacts, num_growing, num_tunnelled, num_recovered = (
            move_particles(
                dt, state, moving, boxed_params, boxed_memory, boxed_particles, boxed_list,
                boxed_pairs, boxed_old_plates, boxed_plates, boxed_plate_memory, boxed_ground,
                boxed_tools,
            )
        )  # fmt: skip
    if todo == READY and num_plate_contacts >= 0:
        if num_locked > 0:
            move_locked_loads(
                params.sleep.gravity, moving.all[num_free:], moving.locked_tool, particles, tools,
                gravity.acceleration,
            )  # fmt: skip
        if num_free > 0:
            plates = boxed_plates.table
            contacts = StepContacts(
                boxed_pairs.table.blocks,
                PlateCandidates(plates.row[:num_plate_contacts], plates.plate[:num_plate_contacts]),
                first_ground_contacts(boxed_ground.table.contacts, num_ground_contacts),
            )
            num_woken, num_asleep, num_locking = update_sleep(
                dt, params.sleep, moving.all[:num_free], memory.inside[:num_free], particles,
                tools, gravity, contacts,
            )  # fmt: skip
        end_tool_motion(tools)
    return (
        todo, num_disturbed, num_free, num_locked, num_plate_contacts, num_growing, num_tunnelled,
        num_recovered, num_woken, num_asleep, num_locking,
    )  # fmt: skip
