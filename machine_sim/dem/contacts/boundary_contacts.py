"""Contacts of a step with plates and with the ground."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.contacts.ground_contacts import list_ground_contacts
from machine_sim.dem.contacts.plate_contact_list import list_plate_contacts
from machine_sim.dem.tools.near_tools import classify_near_tools, select_near_tools
from msg_bridge.kernels import threaded_stages

__all__ = ["list_boundary_contacts"]


@threaded_stages
def list_boundary_contacts(  # type: ignore[no-untyped-def]
    dt, surface_params, rows, particles, tools, ground, old_plates, new_plates, inside
):
    """List the plates, and the ground, that particles may touch within a step.

    Args:
        dt: length of the step [s].
        surface_params: `ContactParameters` of contacts with plates and with the ground.
        rows: particles moved by forces.
        particles: `ParticleColumns`.
        tools: `ToolMotion`.
        ground: `GroundData`, with room for all rows; the contacts are filled.
        old_plates, new_plates: `PlateContactArrays` of the last step and of this one.
        inside: out, index of the tool that each row is in, `NO_TOOL` for none.

    Returns:
        (number of plate contacts, -1 where the table is too small: then only `inside` was changed;
        number of ground contacts).
    """
    near_tools = select_near_tools(dt, rows, particles, tools, ground.cell)
    ground_masked, near = classify_near_tools(near_tools, tools, ground.cell, inside)
    num_plate_contacts, num_ground_contacts = np.int64(0), np.int64(0)
    if tools.twist.shape[0] > 0:
        num_plate_contacts = list_plate_contacts(
            dt, rows, near_tools, particles, tools, old_plates, new_plates
        )
    if num_plate_contacts >= 0:
        num_ground_contacts = list_ground_contacts(
            ground.surface, ground.frame, dt, surface_params, rows, ground_masked, near,
            particles, tools, ground.contacts,
        )  # fmt: skip
    return num_plate_contacts, num_ground_contacts
