"""Support of the dynamic tracks below their axles: contact points fixed to the base.

The ground under a steel wheel is stiffer than that under a shoe. A machine that tips would stand on
the last shoes and fall too early; so each axle has two more contact points, fixed to the base, that
reach the ground when the soles below it are pressed deeper than when the machine stands. Their
normal force acts on the base, their friction on the shoe below the axle. They act on rigid ground
only: on deformable soil the area under the track is that of the shoes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numpy.typing import NDArray

from machine_sim.machine.tracks.bristle_contact import contact_depth
from machine_sim.machine.tracks.rigid_body import (
    FORCE_X,
    FORCE_Y,
    FORCE_Z,
    add_wrench,
    point_velocity,
    to_map,
)
from machine_sim.machine.tracks.shoe_contact import CONTACT_WIDTH_FRACTION, sole_force
from machine_sim.machine.tracks.track_state import (
    SHOE_X,
    SHOE_Z,
    ContactCoefficients,
    ContactPoints,
)
from msg_bridge.kernels import helper

__all__ = ["NUM_AXLE_POINTS", "AxleSupport", "add_axle_forces"]

NUM_AXLE_POINTS = 8
"""Contact points below the axles: two below each."""


class AxleSupport(NamedTuple):
    """Contact points below the axles, left track first, rear before front.

    Attributes:
        clearance: height of the points above the soles of an unloaded track [m].
        coefficients: `ContactCoefficients` of one point, as a plain tuple.
        points: `ContactPoints`, as a plain tuple.
    """

    clearance: float
    coefficients: tuple[float, ...]
    points: tuple[NDArray[Any], ...]


@helper(forceinline=True)
def add_axle_forces(  # type: ignore[no-untyped-def]
    dt, side, base, dimensions, axles, soil, shoe_forces, base_wrench, state
):
    """Add the ground's forces below both axles of a side to the wrenches of base and shoes.

    Args:
        dt: time step [s].
        side: 0 for the left, 1 for the right.
        base: `BaseFrame`.
        dimensions: `TrackDimensions`.
        axles: `AxleSupport`; its contact points are updated.
        soil: `SoilPatch`; its `max_sinkage` is updated.
        shoe_forces: `ShoeBodies.forces`; updated.
        base_wrench: wrench of shoes and ground on the base, map frame, shape (6,); updated.
        state: `TrackState`; its wrench and loads are updated.
    """
    for sign in (-1, 1):
        _add_forces_at_axle(
            dt, side, sign, base, dimensions, axles, soil, shoe_forces, base_wrench, state
        )


@helper(forceinline=True)
def _add_forces_at_axle(  # type: ignore[no-untyped-def]
    dt, side, sign, base, dimensions, axles, soil, shoe_forces, base_wrench, state
):
    """Add the ground's forces on both contact points below the rear (-1) or front (1) axle."""
    coefficients, points = ContactCoefficients(*axles.coefficients), ContactPoints(*axles.points)
    half, radius = dimensions.half_axle_distance, dimensions.sprocket_radius
    k = _lowest_shoe(state.shoe_poses, side, sign * half, dimensions.axle_height)
    shoe_wrench = shoe_forces[side * state.shoe_poses.shape[1] + k]
    y_track = dimensions.half_gauge if side == 0 else -dimensions.half_gauge
    sole = dimensions.axle_height - radius - dimensions.half_thickness + axles.clearance
    (r00, _, _), (r10, _, _), (r20, _, _) = base.rotation
    speed = state.speed[side]
    area = 0.0  # on deformable soil, see above
    com_x, com_y, com_z = dimensions.base_com
    for edge in range(2):
        i = 4 * side + (sign + 1) + edge
        y = y_track + (1 - 2 * edge) * CONTACT_WIDTH_FRACTION * dimensions.half_width
        arm = to_map(base.rotation, (sign * half - com_x, y - com_y, sole - com_z))
        (cx, cy, cz), (ax, ay, az) = base.center_of_mass, arm
        point = (cx + ax, cy + ay, cz + az)
        vx, vy, vz = point_velocity(base.velocity, base.angular_velocity, arm)
        # The lower run moves backward. The anchor stays where the passing sole left it.
        velocity = (vx - speed * r00, vy - speed * r10, vz - speed * r20)
        points.anchors[i, 0] += speed * dt * r00
        points.anchors[i, 1] += speed * dt * r10
        points.anchors[i, 2] += speed * dt * r20
        force, load, _ = sole_force(point, point, velocity, coefficients, area, soil, points, i)
        if load > 0.0:
            _, (nx, ny, nz) = contact_depth(soil.undisturbed_surface, soil.frame, point)
            normal_force = (load * nx, load * ny, load * nz)
            add_wrench(base_wrench, normal_force, arm)
            add_wrench(state.wrench, force, arm)
            shoe_wrench[FORCE_X] += force[0] - normal_force[0]
            shoe_wrench[FORCE_Y] += force[1] - normal_force[1]
            shoe_wrench[FORCE_Z] += force[2] - normal_force[2]
            state.shoe_loads[side, k] += load


@helper(forceinline=True)
def _lowest_shoe(shoe_poses, side, x, axle_height):  # type: ignore[no-untyped-def]
    """Return the index of the shoe of the lower run that is nearest to x [m], base frame."""
    nearest, distance = 0, math.inf
    for k in range(shoe_poses.shape[1]):
        if shoe_poses[side, k, SHOE_Z] < axle_height:
            d = abs(shoe_poses[side, k, SHOE_X] - x)
            if d < distance:
                nearest, distance = k, d
    return nearest
