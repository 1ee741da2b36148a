"""One physics step of all particles: substeps of contact forces and explicit integration."""

from __future__ import annotations

import numpy as np

from machine_sim.particles.jit import kernel
from machine_sim.particles.pairs import pair_forces
from machine_sim.particles.soil_contact import ground_forces
from machine_sim.particles.walls import wall_forces

__all__ = ["run_substeps"]


@kernel
def run_substeps(  # type: ignore[no-untyped-def]
    substeps, gravity, law, friction, tool_friction, ground_friction,
    position, velocity, mass, inverse_mass, radius, contact_radius, soft, force, ground_spring,
    first, second, pairs, touching, pair_spring, buffer, slots,
    walls, wall_row, wall_plate, wall_spring, wall_side,
    frame, corner, corners, owner, path, twist, wrench,
    grounds, ground_row, plane,
):  # fmt: skip
    """Advance by `substeps` of the law's time step, semi-implicit Euler.

    Args:
        gravity: [m/s^2], downward.
        law, friction, tool_friction, ground_friction: contact law and Coulomb coefficients.
        position, velocity, mass, inverse_mass, radius, contact_radius, ground_spring: of the
            particles.
        soft: pushed gently by the ground, see `soil_contact`.
        force: scratch, shape (n, 3), float32.
        first ... slots: pairs, see `pair_forces`.
        walls ... wrench: plate contacts, see `wall_forces`; path holds the poses by substep. The
            wrench sums over the substeps.
        grounds, ground_row, plane: ground contacts, see `ground_forces`.
    """
    dt = np.float64(law[4])
    for s in range(substeps):
        force[:] = np.float32(0.0)
        pair_forces(
            first, second, pairs, touching, pair_spring, position, velocity, inverse_mass,
            contact_radius, force, buffer, slots, law, friction,
        )  # fmt: skip
        wall_forces(
            walls, wall_row, wall_plate, wall_spring, wall_side, position, velocity, mass,
            radius, contact_radius, force, frame, corner, corners, owner, path[s], twist, wrench,
            law, tool_friction,
        )  # fmt: skip
        ground_forces(
            grounds, ground_row, plane, position, velocity, mass, contact_radius, soft,
            ground_spring, force, law, ground_friction,
        )  # fmt: skip
        for i in range(position.shape[0]):
            w = np.float64(inverse_mass[i])
            if w > 0.0:
                velocity[i, 0] += force[i, 0] * w * dt
                velocity[i, 1] += force[i, 1] * w * dt
                velocity[i, 2] += (force[i, 2] * w - gravity) * dt
                position[i, 0] += velocity[i, 0] * dt
                position[i, 1] += velocity[i, 1] * dt
                position[i, 2] += velocity[i, 2] * dt
