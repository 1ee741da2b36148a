"""Stiffness of the ground under the lower run of the dynamic tracks.

A shoe is too light for a spring as stiff as the ground: it would oscillate from step to step. So
the ground's force at a contact point of a shoe has two parts. The one on the shoe is that of a
softer spring. The other one is what a sole pressed against the rail would carry in addition; it
acts on the heavy base. Their sum is the load of a track on a rigid rail, which is straight from
axle to axle. Where the shoe carries more than that sole, the difference is taken off the base, but
not more than the shoe presses on the rail there: the ground pushes, it does not pull.
"""

from __future__ import annotations

from machine_sim.machine.tracks.rigid_body import (
    add_wrench,
    point_velocity,
    to_base,
    to_map,
)
from machine_sim.machine.tracks.shoe_contact import normal_load
from msg_bridge.kernels import helper

__all__ = ["add_rail_load"]


@helper(forceinline=True)
def add_rail_load(  # type: ignore[no-untyped-def]
    arm,
    middle_x,
    soft_load,
    rail_force,
    base,
    dimensions,
    coefficients,
    area,
    soil,
    base_wrench,
    ground_wrench,
):
    """Add the ground's force on the base above a contact point of a shoe to the wrenches.

    Args:
        arm: position of the contact point from the base's centre of mass [m], map frame.
        middle_x: x of the middle of the shoe [m], base frame.
        soft_load: normal force of the ground on the shoe at the point [N].
        rail_force: part of the force of the shoe on the rail that falls to the point [N].
        base: `BaseFrame`.
        dimensions: `TrackDimensions`.
        coefficients: `ContactCoefficients` of a contact point of a sole pressed against the rail.
        area: area of the sole that the point stands for [m^2].
        soil: `SoilPatch`; its `max_sinkage` is updated.
        base_wrench, ground_wrench: wrenches on the base and of the ground on the machine about the
            base's centre of mass, map frame, shape (6,); updated.

    Returns:
        Force on the base [N], negative where the shoe carries more than that sole, and depth of
        the sole below the rail [m]; zeros past the axles.
    """
    com_x, _, com_z = dimensions.base_com
    x, y, _ = to_base(base.rotation, arm)
    x += com_x
    half = dimensions.half_axle_distance
    # The part of this half of the shoe that is between the axles.
    end_x = middle_x + (0.5 if x > middle_x else -0.5) * dimensions.sprocket_radius
    length = min(max(middle_x, end_x), half) - max(min(middle_x, end_x), -half)
    if not length > 0.0:
        return 0.0, 0.0
    z = dimensions.axle_height - dimensions.sprocket_radius - dimensions.half_thickness
    sole_arm = to_map(base.rotation, (min(max(x, -half), half) - com_x, y, z - com_z))
    (cx, cy, cz), (ax, ay, az) = base.center_of_mass, sole_arm
    load, depth, (nx, ny, nz) = normal_load(
        (cx + ax, cy + ay, cz + az),
        point_velocity(base.velocity, base.angular_velocity, sole_arm),
        coefficients,
        area,
        soil,
    )
    load *= length / (0.5 * dimensions.sprocket_radius)
    load = max(load - soft_load, -rail_force)
    force = (load * nx, load * ny, load * nz)
    add_wrench(base_wrench, force, sole_arm)
    add_wrench(ground_wrench, force, sole_arm)
    return load, depth
