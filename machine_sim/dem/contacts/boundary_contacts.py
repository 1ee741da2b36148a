"""Contacts of a step with plates and with the ground, listed in one call."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.contacts.ground_contacts import list_ground_contacts
from machine_sim.dem.contacts.plate_contact_list import list_plate_contacts
from machine_sim.dem.tools.near_tools import classify_near_tools, select_near_tools
from msg_bridge.kernels import threaded_stages

__all__ = ["list_boundary_contacts"]


@threaded_stages
def list_boundary_contacts(  # type: ignore[no-untyped-def]
    dt, params, rows, boxed_particles, boxed_tools, boxed_ground, old_plates, new_plates
):
    """List the plates, and the ground, that particles may touch within a step.

    Args:
        dt: length of the step [s].
        params: `MotionParams`, boxed.
        rows: particles moved by forces.
        boxed_particles: `StepParticles`, boxed.
        boxed_tools: `ToolMotion`, boxed.
        boxed_ground: `GroundData`, boxed, with room for all rows; the contacts are filled.
        old_plates, new_plates: `PlateContactArrays` of the last step and of this one, boxed.

    Returns:
        (index of the tool that each row is in, `NO_TOOL` for none; number of plate contacts, -1
        where the table is too small and nothing was changed; number of ground contacts).
    """
    particles, tools, ground = boxed_particles.table, boxed_tools.table, boxed_ground.table
    near_tools = select_near_tools(dt, rows, particles, tools, ground.cell)
    inside, ground_masked, near = classify_near_tools(near_tools, rows.size, tools, ground.cell)
    num_plate_contacts, num_ground_contacts = np.int64(0), np.int64(0)
    if tools.twist.shape[0] > 0:
        num_plate_contacts = list_plate_contacts(
            dt, rows, near_tools, particles, tools, old_plates.table, new_plates.table
        )
    if num_plate_contacts >= 0:
        num_ground_contacts = list_ground_contacts(
            ground.surface, ground.frame, dt, params.table.surface, rows, ground_masked, near,
            particles, ground.contacts.row, ground.contacts.plane,
        )  # fmt: skip
    return inside, num_plate_contacts, num_ground_contacts
