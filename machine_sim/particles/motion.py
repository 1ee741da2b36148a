"""One physics step of all particles: substeps of contact forces and explicit integration."""

from __future__ import annotations

import numpy as np
from numba import prange

from machine_sim.particles.bodies import advance_bodies, advance_riders
from machine_sim.particles.jit import threaded_kernel
from machine_sim.particles.pairs.forces import pair_forces
from machine_sim.particles.parts import CHUNKS, chunk, spread
from machine_sim.particles.soil_contact import ground_forces
from machine_sim.particles.walls.forces import wall_forces

__all__ = ["run_substeps"]


@threaded_kernel
def run_substeps(  # type: ignore[no-untyped-def]
    substeps, gravity, law, wall_law, ground_friction, ground_rolling,
    rows, riders, rider_tool, body, total,
    position, mass, radius, soft, ground_spring,
    first, second, block, begin, size,
    walls, wall_plate, wall_size, wall_row, tool_row, wall_block,
    plates, owner, path, twist, wrench,
    grounds, ground_row, plane,
):  # fmt: skip
    """Advance by `substeps` of the law's time step, semi-implicit Euler.

    Args:
        gravity: [m/s^2], downward.
        law, wall_law: contact law between particles, and at tools and the ground.
        ground_friction, ground_rolling: coefficients.
        rows: who moves by forces.
        riders, rider_tool: who rides in a tool, and in which.
        body, total: records and cleared sums, see `bodies`.
        position ... ground_spring: of the particles, columns of the store.
        first ... size: contacts, see `ContactTable`; every other part is a seam.
        walls ... wrench: plate contacts, see `wall_forces`; path holds the poses by substep. The
            wrench sums over the substeps.
        grounds, ground_row, plane: ground contacts, see `ground_forces`.
    """
    dt = np.float32(law[4])
    for s in range(substeps):
        for kind in range(2):
            parts = (begin.size + 1 - kind) // 2
            for r in prange(parts):
                part = 2 * spread(r, parts) + kind
                pair_forces(begin[part], size[part], first, second, block, body, total, law)
        wall_forces(
            walls, wall_plate, wall_size, wall_row, tool_row, wall_block, body, total,
            plates, owner, path[0], path[s], twist, wrench, wall_law,
        )  # fmt: skip
        for c in prange(CHUNKS):
            ground_forces(
                c * grounds // CHUNKS, (c + 1) * grounds // CHUNKS, ground_row, plane, position,
                mass, soft, ground_spring, body, total, wall_law, ground_friction, ground_rolling,
            )  # fmt: skip
        for c in prange(CHUNKS):
            advance_bodies(chunk(rows, c), body, total, radius, np.float32(gravity), dt)
        advance_riders(riders, rider_tool, body, total, position, path[s], wrench, dt)
