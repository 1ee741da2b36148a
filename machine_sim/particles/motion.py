"""One physics step of all particles: substeps of contact forces and explicit integration."""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.jit import threaded_kernel
from machine_sim.particles.bodies import advance_bodies, advance_riders
from machine_sim.particles.pairs.forces import pair_forces
from machine_sim.particles.parts import CHUNKS, chunk, spread
from machine_sim.particles.soil_contact import ground_forces
from machine_sim.particles.walls.forces import wall_forces

__all__ = ["run_substeps"]


@threaded_kernel
def run_substeps(  # type: ignore[no-untyped-def]
    substeps, gravity, laws, ground_friction, ground_rolling, rows, riders, rider_tool, body, total,
    position, mass, radius, soft, ground_spring, contacts, walls, tools, grounds,
):  # fmt: skip
    """Advance by `substeps` of the laws' time step, semi-implicit Euler.

    Args:
        gravity: [m/s^2], downward.
        laws: contact law between particles, and at tools and the ground.
        ground_friction, ground_rolling: coefficients.
        rows: who moves by forces.
        riders, rider_tool: who rides in a tool, and in which.
        body, total: records and cleared sums, see `bodies`.
        position ... ground_spring: of the particles, columns of the store.
        contacts: of particles, `ContactBlocks`; every other part is a seam.
        walls: plate contacts, `WallBlocks`.
        tools: `ToolMotion`; the wrench sums over the substeps.
        grounds: `GroundContacts`.
    """
    law, wall_law = laws
    dt = np.float32(law[4])
    begin, size = contacts.begin, contacts.size
    touching = grounds.row.size
    for s in range(substeps):
        for kind in range(2):
            parts = (begin.size + 1 - kind) // 2
            for r in prange(parts):
                part = 2 * spread(r, parts) + kind
                pair_forces(begin[part], size[part], contacts, body, total, law)
        wall_forces(walls, body, total, tools, s, wall_law)
        for c in prange(CHUNKS):
            ground_forces(
                c * touching // CHUNKS, (c + 1) * touching // CHUNKS, grounds, position, mass, soft,
                ground_spring, body, total, wall_law, ground_friction, ground_rolling,
            )  # fmt: skip
        for c in prange(CHUNKS):
            advance_bodies(chunk(rows, c), body, total, radius, np.float32(gravity), dt)
        advance_riders(riders, rider_tool, body, total, position, tools, s, dt)
