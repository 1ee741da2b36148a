"""One physics step of all particles: substeps of contact forces and explicit integration."""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.dem.contacts.ground_contacts import ground_forces
from machine_sim.dem.contacts.pair_forces import pair_forces
from machine_sim.dem.contacts.plate_forces import plate_forces
from machine_sim.dem.integrate import advance_locked_loads, integrate_bodies
from machine_sim.dem.partition import NUM_CHUNKS, interleave, row_chunk
from msg_bridge.kernels import threaded_kernel

__all__ = ["run_substeps"]


@threaded_kernel
def run_substeps(  # type: ignore[no-untyped-def]
    substeps, gravity, pair_and_boundary_params, ground_friction, ground_rolling_friction, rows, locked_rows, locked_tool, body, force_sums,
    position, mass, radius, penetration_limited, ground_spring, contacts, plate_contacts, tools, ground_contacts,
):  # fmt: skip
    """Advance by `substeps` of the laws' time step, semi-implicit Euler.

    Args:
        gravity: [m/s^2], downward.
        laws: contact law between particles, and at tools and the ground.
        ground_friction, ground_rolling_friction: coefficients.
        rows: who moves by forces.
        riders, rider_tool: who rides in a tool, and in which.
        body, total: records and cleared sums, see `bodies`.
        position ... ground_spring: of the particles, columns of the store.
        contacts: of particles, `PairContactBlocks`; every other part is a seam.
        walls: plate contacts, `PlateContactBlocks`.
        tools: `ToolMotion`; the wrench sums over the substeps.
        grounds: `GroundContacts`.
    """
    contact_params, boundary_params = pair_and_boundary_params
    dt = np.float32(contact_params[4])
    begin, size = contacts.begin, contacts.size
    touching = ground_contacts.row.size
    for s in range(substeps):
        for kind in range(2):
            parts = (begin.size + 1 - kind) // 2
            for r in prange(parts):
                part = 2 * interleave(r, parts) + kind
                pair_forces(begin[part], size[part], contacts, body, force_sums, contact_params)
        plate_forces(plate_contacts, body, force_sums, tools, s, boundary_params)
        for c in prange(NUM_CHUNKS):
            ground_forces(
                c * touching // NUM_CHUNKS, (c + 1) * touching // NUM_CHUNKS, ground_contacts, position, mass, penetration_limited,
                ground_spring, body, force_sums, boundary_params, ground_friction, ground_rolling_friction,
            )  # fmt: skip
        for c in prange(NUM_CHUNKS):
            integrate_bodies(row_chunk(rows, c), body, force_sums, radius, np.float32(gravity), dt)
        advance_locked_loads(locked_rows, locked_tool, body, force_sums, position, tools, s, dt)
