"""Kernel of the dynamic tracks: forces of ground and undercarriage on rigid shoes.

Sprockets and idlers are simulated by the physics engine. The undercarriage guides the shoes between
them (`undercarriage`). The ground acts on four contact points of each shoe (`shoe_contact`), on the
base above them (`rail_support`) and on two points below each axle (`axle_support`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.box import Vec3
from machine_sim.machine.tracks.axle_support import AxleSupport, add_axle_forces
from machine_sim.machine.tracks.chain_deviation import chain_deviation, local_position
from machine_sim.machine.tracks.rail_support import add_rail_load
from machine_sim.machine.tracks.rigid_body import (
    FORCE_X,
    FORCE_Y,
    FORCE_Z,
    add_wrench,
    base_frame,
    dot,
    point_velocity,
    row_vector,
    to_base,
    to_map,
)
from machine_sim.machine.tracks.shoe_chain import (
    SHOE_ANGULAR_VELOCITY,
    SHOE_POSITION,
    SHOE_QUATERNION,
    SHOE_VELOCITY,
)
from machine_sim.machine.tracks.shoe_contact import (
    CONTACT_WIDTH_FRACTION,
    MAX_OUTWARD_Z,
    mean_depth,
    normal_load,
    shear_force,
)
from machine_sim.machine.tracks.terramechanics import SoilPatch
from machine_sim.machine.tracks.track_slip import update_mean_speeds
from machine_sim.machine.tracks.track_state import (
    SHOE_PITCH,
    SHOE_X,
    SHOE_Z,
    ContactCoefficients,
    ContactPoints,
    TrackDimensions,
    TrackState,
)
from machine_sim.machine.tracks.undercarriage import UndercarriageSupport, support_force
from msg_bridge.kernels import helper, kernel

__all__ = ["POINTS_PER_SHOE", "ShoeBodies", "dynamic_track_step"]

Array = NDArray[np.float64]

POINTS_PER_SHOE = 4
"""Contact points of a shoe: one near each corner."""

_CONTACT_LENGTH_FRACTION = 0.45
"""Distance of the contact points from the middle of the shoe along the track, in lengths."""


class ShoeBodies(NamedTuple):
    """Shoes of both tracks as rigid bodies, left track first; N shoes to a track.

    Attributes:
        states: as read by `ShoeChains.read`, shape (2 N, 13).
        brake_anchors: x in the base frame at which the brake holds each shoe [m], NaN where it does
            not, shape (2, N).
        forces: force [N] and torque about its centre [N m] on each shoe, map frame, shape (2 N, 6).
        path_deviations: `chain_deviation` of each side [m], shape (2,).
    """

    states: Array
    brake_anchors: Array
    forces: Array
    path_deviations: Array


class _Shoe(NamedTuple):
    """One shoe: map frame, velocities relative to the ground.

    Attributes:
        position, velocity, angular_velocity: centre [m], [m/s], [rad/s].
        forward, left, outward: unit vectors of its axes: direction of motion, lateral, out of the
            track.
        arm: position relative to the base's centre of mass [m].
        base_velocity: velocity of the base at the shoe [m/s].
    """

    position: Vec3
    velocity: Vec3
    angular_velocity: Vec3
    forward: Vec3
    left: Vec3
    outward: Vec3
    arm: Vec3
    base_velocity: Vec3


@kernel
def dynamic_track_step(  # type: ignore[no-untyped-def]
    dt,
    motion,
    dimensions,
    supports,
    coefficients,
    rail_coefficients,
    soil,
    points,
    axles,
    is_braked,
    shoes,
    base_wrench,
    state,
):
    """Find the forces on shoes and base, and the speeds of the belts.

    The structures are plain tuples with the elements of the named ones; see `track_state`.

    Args:
        dt: time step [s].
        motion: packed motion of the base, see `base_motion`.
        dimensions: `TrackDimensions`.
        supports: `UndercarriageSupport`.
        coefficients: `ContactCoefficients` of one contact point of a shoe.
        rail_coefficients: those of one of a sole pressed against the rail.
        soil: `SoilPatch` under the shoes; its `max_sinkage` is updated.
        points: `ContactPoints` of the shoes, `POINTS_PER_SHOE` each, left track first; updated.
        axles: `AxleSupport`; its contact points are updated.
        is_braked: whether the brake is on, left and right.
        shoes: `ShoeBodies`; all but the states is updated.
        base_wrench: out, force [N] of shoes and ground on the base and torque about its centre of
            mass [N m], map frame, shape (6,).
        state: `TrackState`; all but travel and drive forces is updated. The wrench is that of the
            ground on shoes and base.
    """
    dimensions = TrackDimensions(*dimensions)
    supports, coefficients = UndercarriageSupport(*supports), ContactCoefficients(*coefficients)
    rail_coefficients = ContactCoefficients(*rail_coefficients)
    soil, points, shoes = SoilPatch(*soil), ContactPoints(*points), ShoeBodies(*shoes)
    state, axles = TrackState(*state), AxleSupport(*axles)
    base = base_frame(motion)
    base_wrench[:] = 0.0
    state.wrench[:] = 0.0
    count = state.shoe_poses.shape[1]
    for side in range(2):
        y_track = dimensions.half_gauge if side == 0 else -dimensions.half_gauge
        sum_speed, num_running = 0.0, 0
        total_load, load_depth = 0.0, 0.0
        for k in range(count):
            i = side * count + k
            shoe = _shoe(shoes.states, i, base)
            local = local_position(shoe.arm, base, dimensions.base_com, y_track)
            relative_velocity = _difference(shoe.velocity, shoe.base_velocity)
            _write_pose(state.shoe_poses, side, k, local, to_base(base.rotation, shoe.forward))
            if abs(local[0]) <= dimensions.half_axle_distance:
                num_running += 1
                sum_speed += dot(relative_velocity, shoe.forward)
            support = support_force(
                local,
                to_base(base.rotation, relative_velocity),
                dimensions,
                supports,
                is_braked[side],
                shoes.brake_anchors,
                side,
                k,
            )
            force = to_map(base.rotation, support)
            shoe_wrench = shoes.forces[i]
            shoe_wrench[:] = 0.0
            shoe_wrench[FORCE_X], shoe_wrench[FORCE_Y], shoe_wrench[FORCE_Z] = force
            add_wrench(base_wrench, (-force[0], -force[1], -force[2]), shoe.arm)
            load, load_depth = _add_sole_forces(
                shoe,
                i,
                local,
                max(-support[2], 0.0),
                base,
                dimensions,
                coefficients,
                rail_coefficients,
                soil,
                points,
                shoe_wrench,
                base_wrench,
                state.wrench,
                load_depth,
            )
            total_load += load
            state.shoe_loads[side, k] = load
        state.speed[side] = sum_speed / max(num_running, 1)
        add_axle_forces(dt, side, base, dimensions, axles, soil, shoes.forces, base_wrench, state)
        update_mean_speeds(
            state.mean_speeds, side, dt, state.speed[side], base, dimensions.base_com, y_track
        )
        chain = shoes.states[side * count : (side + 1) * count]
        shoes.path_deviations[side] = chain_deviation(chain, base, dimensions, y_track)
        state.sinkage[side] = mean_depth(load_depth, total_load)


@helper(forceinline=True)
def _difference(a, b):  # type: ignore[no-untyped-def]
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@helper(forceinline=True)
def _shoe(states, i, base):  # type: ignore[no-untyped-def]
    """Return shoe `i` as a `_Shoe`."""
    position = row_vector(states, i, SHOE_POSITION)
    x, y, z = row_vector(states, i, SHOE_QUATERNION)
    w = states[i, SHOE_QUATERNION + 3]
    arm = _difference(position, base.center_of_mass)
    return _Shoe(
        position,
        row_vector(states, i, SHOE_VELOCITY),
        row_vector(states, i, SHOE_ANGULAR_VELOCITY),
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
        arm,
        point_velocity(base.velocity, base.angular_velocity, arm),
    )


@helper(forceinline=True)
def _write_pose(shoe_poses, side, k, local, forward):  # type: ignore[no-untyped-def]
    """Write the pose of a shoe from its position and its direction of motion, base frame."""
    shoe_poses[side, k, SHOE_X] = local[0]
    shoe_poses[side, k, SHOE_Z] = local[2]
    shoe_poses[side, k, SHOE_PITCH] = math.atan2(-forward[2], forward[0])


# An argument for each wrench and each part of the ground.
@helper(forceinline=True)
def _add_sole_forces(  # type: ignore[no-untyped-def]
    shoe,
    i,
    local,
    rail_force,
    base,
    dimensions,
    coefficients,
    rail_coefficients,
    soil,
    points,
    shoe_wrench,
    base_wrench,
    ground_wrench,
    load_depth,
):
    """Add the ground's forces at a shoe to the wrenches on it, on the base and on the machine.

    Args:
        shoe: `_Shoe`.
        i: index of the shoe.
        local: position of the shoe as from `local_position` [m].
        rail_force: force of the shoe on the rail [N].
        base: `BaseFrame`.
        dimensions: `TrackDimensions`.
        coefficients, rail_coefficients, soil, points: as for `dynamic_track_step`.
        shoe_wrench: wrench on the shoe about its centre; updated.
        base_wrench, ground_wrench: wrenches on base and machine about the base's centre of mass;
            updated.
        load_depth: sum of load times depth [N m].

    Returns:
        Normal load at the shoe [N], and `load_depth` with the load times depth of its contact
        points added [N m].
    """
    total_load = 0.0
    length, half_width = dimensions.sprocket_radius, dimensions.half_width
    half_thickness = dimensions.half_thickness
    area = 0.5 * length * half_width  # of one contact point
    is_below = local[2] < dimensions.axle_height
    (px, py, pz), (ax, ay, az) = shoe.position, shoe.arm
    (fx, fy, fz), (lx, ly, lz), (nx, ny, nz) = shoe.forward, shoe.left, shoe.outward
    for corner in range(POINTS_PER_SHOE):
        c = POINTS_PER_SHOE * i + corner
        if nz > MAX_OUTWARD_Z:
            points.is_active[c] = False
            continue
        u = _CONTACT_LENGTH_FRACTION * length
        if not corner & 1:
            u = -u
        w = CONTACT_WIDTH_FRACTION * half_width
        if not corner & 2:
            w = -w
        rx = u * fx + w * lx + half_thickness * nx
        ry = u * fy + w * ly + half_thickness * ny
        rz = u * fz + w * lz + half_thickness * nz
        point, arm = (px + rx, py + ry, pz + rz), (ax + rx, ay + ry, az + rz)
        velocity = point_velocity(shoe.velocity, shoe.angular_velocity, (rx, ry, rz))
        soft_load, depth, normal = normal_load(point, velocity, coefficients, area, soil)
        load = soft_load
        if is_below:
            rail_load, rail_depth = add_rail_load(
                arm,
                local[0],
                soft_load,
                rail_force / POINTS_PER_SHOE,
                base,
                dimensions,
                rail_coefficients,
                area,
                soil,
                base_wrench,
                ground_wrench,
            )
            load = soft_load + rail_load
            if rail_load > 0.0:
                depth = rail_depth
        tx, ty, tz = 0.0, 0.0, 0.0
        if load > 0.0:
            total_load += load
            load_depth += load * depth
            tx, ty, tz = shear_force(
                point, point, velocity, normal, load, coefficients, area, soil, points, c
            )
        else:
            points.is_active[c] = False
            if soft_load == 0.0:
                continue
        # The whole force of the ground on the shoe, also where the rail takes all of it off again.
        force = (
            tx + soft_load * normal[0],
            ty + soft_load * normal[1],
            tz + soft_load * normal[2],
        )
        add_wrench(shoe_wrench, force, (rx, ry, rz))
        add_wrench(ground_wrench, force, arm)
    return total_load, load_depth
