"""Forces of the ground on particles in a substep."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.body_records import (
    CONTACT_RADIUS,
    DISPLACEMENT,
    FORCE,
    ROLLING_LIMIT,
    SURFACE_VELOCITY,
    TORQUE_OVER_RADIUS,
    VELOCITY,
)
from machine_sim.dem.contacts.contact_law import contact_force
from machine_sim.dem.contacts.ground_contacts import max_limited_overlap, reset_spring
from machine_sim.dem.tools.plane import PLANE_NORMAL, signed_distance
from machine_sim.dem.vec3 import add, cross, load_row, scale, store_row, subtract
from msg_bridge.kernels import kernel

__all__ = ["ground_forces"]


@kernel(forceinline=True)
def ground_forces(  # type: ignore[no-untyped-def]
    low, high, contacts, particles, body, force_sums, params, friction, rolling_friction
):
    """Add the forces of a range of ground contacts to the sums of their particles.

    Args:
        low, high: first contact of the range and its end, which is excluded.
        contacts: `GroundContacts`.
        particles: `StepParticles`, with positions at the start of the step; springs are updated.
        body, force_sums: see `body_records`.
        params: `ContactParameters`.
        friction, rolling_friction: coefficients at the ground.
    """
    row, plane, spring = contacts.row, contacts.plane, particles.ground_spring
    position, mass_of_row = particles.position, particles.mass
    penetration_limited = particles.penetration_limited
    limited_overlap = max_limited_overlap(params)
    for c in range(low, high):
        i = row[c]
        normal = load_row(plane, c, PLANE_NORMAL)
        centre = add(load_row(position, i, 0), load_row(body, i, DISPLACEMENT))
        contact_radius = np.float64(body[i, CONTACT_RADIUS])
        # The overlap is limited to one radius: deeper ones are for `ground_recovery`.
        overlap = min(contact_radius - signed_distance(plane[c], *centre), contact_radius)
        if overlap <= 0.0:
            reset_spring(spring, i)
            continue
        if penetration_limited[i]:
            overlap = min(overlap, limited_overlap)
        surface_velocity = cross(load_row(body, i, SURFACE_VELOCITY), normal)
        contact_velocity = subtract(load_row(body, i, VELOCITY), surface_velocity)
        normal_force, friction_force, elongation = contact_force(
            params, friction, overlap, normal, contact_velocity, load_row(spring, i, 0)
        )
        store_row(spring, i, 0, elongation)
        mass = mass_of_row[i]
        force = scale(add(scale(normal, normal_force), friction_force), mass)
        torque_over_radius = scale(cross(friction_force, normal), mass)
        store_row(force_sums, i, FORCE, add(load_row(force_sums, i, FORCE), force))
        force_sums[i, ROLLING_LIMIT] += mass * normal_force * rolling_friction
        store_row(
            force_sums, i, TORQUE_OVER_RADIUS,
            add(load_row(force_sums, i, TORQUE_OVER_RADIUS), torque_over_radius),
        )  # fmt: skip
