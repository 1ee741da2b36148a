"""Motion of the particles in a step: contacts, substeps, and what is checked after.

    contacts with plates and ground -> growth -> body records -> pair contacts -> plate contacts
    -> substeps -> positions -> tunnelling -> recovery on the ground and settle timers

`particle_step` calls it between the start and the end of a step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from machine_sim.dem.body_records import load_body_records, store_body_records
from machine_sim.dem.contacts.boundary_contacts import list_boundary_contacts
from machine_sim.dem.contacts.contact_law import ContactParameters
from machine_sim.dem.contacts.ground_contact_blocks import (
    fill_ground_blocks,
    store_ground_springs,
)
from machine_sim.dem.contacts.ground_contacts import (
    first_ground_contacts,
    max_limited_overlap,
)
from machine_sim.dem.contacts.ground_recovery import recover_and_time_settling
from machine_sim.dem.contacts.pair_contacts import update_pair_contacts
from machine_sim.dem.contacts.plate_contact_list import PlateCandidates
from machine_sim.dem.contacts.plate_contacts import fill_plate_blocks, store_plate_history
from machine_sim.dem.contacts.tunnelling import count_tunnelled
from machine_sim.dem.lifecycle.growth import grow_radii, set_initial_radii
from machine_sim.dem.sleep.sleep_state import SleepParams
from machine_sim.dem.substeps import LockedRows, SubstepParams, run_substeps
from msg_bridge.kernels import helper, threaded_stages

__all__ = ["StepParams", "move_particles"]


class StepParams(NamedTuple):
    """Physics of steps of one length.

    Attributes:
        sleep: parameters of sleep.
        substeps: number of substeps, gravity and coefficients of the ground.
        pairs, surface: contact law of pairs, and of plates and the ground.
        settle_speed: speed below which the settle timer of a particle on the ground runs [m/s].
        max_initial_radius: maximum contact radius of a particle just released, in radii.
        max_growth: maximum growth of a contact radius in a step, in radii.
    """

    sleep: SleepParams
    substeps: SubstepParams
    pairs: ContactParameters
    surface: ContactParameters
    settle_speed: float
    max_initial_radius: float
    max_growth: float


@threaded_stages
def move_particles(  # type: ignore[no-untyped-def]
    dt, step, moving, boxed_params, boxed_memory, boxed_particles, boxed_list, boxed_pairs,
    boxed_old_plates, boxed_plates, boxed_plate_memory, boxed_ground, boxed_tools,
):  # fmt: skip
    """Advance all particles that move by one step.

    Args:
        dt: length of the step [s].
        step: `StepState` of `particle_step`.
        moving: `MovingRows`.
        boxed_params: `StepParams`, boxed, as the tables below.
        boxed_memory: `StepMemory`.
        boxed_particles: `ParticleColumns`; updated.
        boxed_list: `ListedPairs`.
        boxed_pairs: `PairContactData`, updated.
        boxed_old_plates, boxed_plates: `PlateContactArrays` of the last step, and of this one; the
            latter are filled.
        boxed_plate_memory: `PlateContactMemory`.
        boxed_ground: `GroundData`, with room for all rows; the contacts are filled.
        boxed_tools: `ToolMotion`; the wrenches are summed over the substeps.

    Returns:
        (number of contacts with plates, -1 where the table is too small and nothing was moved;
        number of contacts with the ground; number of particles that still grow; number that passed
        through a plate; number that were put back on the ground).
    """
    params, particles = boxed_params.table, boxed_particles.table
    listed, pairs = boxed_list.table, boxed_pairs.table
    plates, plate_memory = boxed_plates.table, boxed_plate_memory.table
    ground, tools = boxed_ground.table, boxed_tools.table
    memory = boxed_memory.table
    body, force_sums = memory.body, memory.force_sums
    position, velocity = particles.position, particles.velocity
    rows, angular_velocity = moving.all[: moving.num_free], particles.angular_velocity
    num_plate_contacts, num_ground_contacts = list_boundary_contacts(
        dt, params.surface, rows, particles, tools, ground, boxed_old_plates.table, plates,
        memory.inside[: rows.size],
    )  # fmt: skip
    num_growing, num_tunnelled = np.int64(0), np.int64(0)
    if num_plate_contacts < 0:
        return num_plate_contacts, num_ground_contacts, num_growing, num_tunnelled, np.int64(0)
    listed_plates = PlateCandidates(
        plates.row[:num_plate_contacts], plates.plate[:num_plate_contacts]
    )
    ground_contacts = first_ground_contacts(ground.contacts, num_ground_contacts)
    if step.grows:
        num_pairs = listed.bounds[-1]
        first, second = listed.arrays.first[:num_pairs], listed.arrays.second[:num_pairs]
        if step.sets_initial_radii:
            set_initial_radii(
                params.max_initial_radius, first, second, particles, listed_plates, tools,
                ground_contacts,
            )  # fmt: skip
        num_growing = grow_radii(params.max_growth, first, second, particles)
    loaded_rows = memory.all_rows[: particles.radius.size] if step.loads_all else moving.all
    load_body_records(
        loaded_rows, body, force_sums, velocity, angular_velocity, particles.contact_radius,
        particles.radius, particles.inverse_mass, particles.sleep_state,
    )  # fmt: skip
    update_pair_contacts(
        np.float32(dt), listed.arrays, listed.bounds, particles, body, pairs.blocks, pairs.source,
        step.rebuilds_contacts, step.grows,
    )  # fmt: skip
    plate_contacts = fill_plate_blocks(
        listed_plates, plates.spring, plates.side, particles, tools, body, force_sums,
        plate_memory.blocks, plate_memory.slot,
    )  # fmt: skip
    fill_ground_blocks(
        ground_contacts, particles, max_limited_overlap(params.surface), ground.blocks
    )
    has_tools = tools.twist.shape[0] > 0
    before = _positions_of(rows if has_tools else rows[:0], position)
    run_substeps(
        params.substeps, params.pairs, params.surface, rows,
        LockedRows(moving.all[moving.num_free :], moving.locked_tool), body, force_sums, position,
        pairs.blocks, plate_contacts, num_ground_contacts, ground.blocks, tools,
    )  # fmt: skip
    store_ground_springs(ground_contacts.row, ground.blocks.block, particles.ground_spring)
    store_plate_history(
        num_plate_contacts, plate_memory.slot, plate_memory.blocks.block, plates.spring, plates.side
    )
    store_body_records(rows, body, position, velocity, angular_velocity)
    if has_tools:
        num_tunnelled = count_tunnelled(rows, before, particles, tools, plates)
    num_recovered = recover_and_time_settling(
        ground.surface, ground.frame, dt, params.settle_speed, rows, ground_contacts, particles
    )
    return num_plate_contacts, num_ground_contacts, num_growing, num_tunnelled, num_recovered


@helper(allocates=True)
def _positions_of(rows, position):  # type: ignore[no-untyped-def]
    """Return the centres of some particles [m], shape (rows, 3)."""
    centres = np.empty((rows.size, 3))
    for n in range(rows.size):
        for axis in range(3):
            centres[n, axis] = position[rows[n], axis]
    return centres
