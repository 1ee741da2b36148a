"""Kernel of the hinged tracks: what ground and undercarriage do to rigid shoes.

Sprocket and idler are the physics engine's. All else that keeps a shoe where it belongs is a
spring and a damper here, frictionless and felt by the base in turn: the rail below, carriers above
that neither let the slack run sag nor buckle, flanges that keep the chain in line, and a brake.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from machine_sim.machine.tracks.kinematic_step import add_wrench, update_mean_speeds
from machine_sim.machine.tracks.terramechanics import sole_force
from msg_bridge.kernels import kernel

__all__ = ["TrackDimensions", "UndercarriageSupport", "dynamic_track_step"]

_CONTACT_ALONG, _CONTACT_ACROSS = 0.45, 0.9
"""Where a shoe's four contact points are, in parts of its length and of its half width."""

_MAX_OUTWARD_Z = 0.3
"""A shoe whose outside looks up more than this (world z of its normal) touches no ground."""

_BEVEL_START, _BEVEL_SLOPE = 1.57, 0.2
"""Rail and carriers give way by this slope from that many shoes before an axle on: a chain comes
off the flats of a sprocket now higher, now lower."""

_CARRIER_CLEARANCE = 0.01
"""How far the run above can sag and rise before carriers act [m]."""


class TrackDimensions(NamedTuple):
    """Dimensions of the tracks [m], the base frame's axes."""

    half_axle_distance: float  # of the axle distance
    sprocket_radius: float  # of the sprocket's corners, where hinges go round; a shoe is as long
    half_gauge: float
    half_width: float  # of a shoe
    half_thickness: float
    axle_height: float  # height of the axles


class UndercarriageSupport(NamedTuple):
    """Springs and dampers between one shoe and the base, and how strong the brake is."""

    stiffness: float  # of flanges, carriers and brake [N/m]
    damping: float  # [N s/m]
    rail_stiffness: float
    rail_damping: float
    max_brake_force: float  # greatest force of the brake [N]
    sole_damping: float  # between the base and the ground under a shoe that bears it [N s/m]


@kernel(inline="always")
def _support_force(x, y, z, vx, vy, vz, dimensions, supports, brake, brake_anchors, side, k):  # type: ignore[no-untyped-def]
    """Force (fx, fy, fz) [N] on a shoe, and whether the rail is on it.

    The shoe is at x, y, z [m] in the base frame, y from its track's middle, and moves with v [m/s]
    there.
    """
    fx, fy, fz, borne = 0.0, 0.0, 0.0, False
    between = abs(x) <= dimensions.half_axle_distance
    give = _BEVEL_SLOPE * max(
        abs(x) - dimensions.half_axle_distance + _BEVEL_START * dimensions.sprocket_radius, 0.0
    )
    if z < dimensions.axle_height:
        fy = -supports.stiffness * y - supports.damping * vy
        over = z - (dimensions.axle_height - dimensions.sprocket_radius + give)
        if between and over > 0.0:
            borne = True
            fz = -max(supports.rail_stiffness * over + supports.rail_damping * vz, 0.0)
    elif between:
        off = z - dimensions.axle_height - dimensions.sprocket_radius
        over = max(off - _CARRIER_CLEARANCE, 0.0) + min(off + _CARRIER_CLEARANCE + give, 0.0)
        force = -supports.stiffness * over - supports.damping * vz
        if force * over < 0.0:
            fz = force
    if brake and between and z < dimensions.axle_height:
        if math.isnan(brake_anchors[side, k]):
            brake_anchors[side, k] = x
        fx = -supports.stiffness * (x - brake_anchors[side, k]) - supports.damping * vx
        if abs(fx) > supports.max_brake_force:
            fx = math.copysign(supports.max_brake_force, fx)
            # The grip follows, so that the spring alone gives the sliding force.
            brake_anchors[side, k] = x + fx / supports.stiffness
    else:
        brake_anchors[side, k] = math.nan
    return fx, fy, fz, borne


@kernel
def dynamic_track_step(  # type: ignore[no-untyped-def]
    dt,
    com,
    rotation,
    velocity,
    angular_velocity,
    base_com,
    dimensions,
    supports,
    contact_coefficients,
    brakes,
    soil_patch,
    states,
    brake_anchors,
    anchors,
    active,
    shear_displacement,
    forces,
    shoes,
    loads,
    sinkage,
    mean_speeds,
    speed,
    path_deviations,
    base_wrench,
    wrench,
):
    """Find what acts on each shoe and on the base, and how the belts run.

    Args:
        dt: time step [s].
        com, rotation, velocity, spin: base centre of mass [m], base to map (3, 3), velocity of the
            centre of mass [m/s] and angular velocity [rad/s], map frame.
        base_com: centre of mass in the base frame [m].
        gear, supports: of the tracks.
        laws: kn, cn, kt, ct of one contact point and its friction coefficient.
        brakes: whether the brakes are on, left, right.
        bed: the ground under the shoes.
        states: position [m], quaternion x, y, z, w, velocity [m/s], angular velocity [rad/s] of
            each shoe, map frame, shape (2 N, 13), left track first.
        grips: x [m] in the base frame where the brake holds each shoe, NaN if it does not, shape
            (2, N); updated.
        anchors, active, sheared: of the contact points, four to a shoe, shapes (8 N, 3), (8 N,) and
            (8 N,); updated.
        forces: out, force [N] and torque about its middle [N m] on each shoe, shape (2 N, 6).
        shoes: out, x, z [m] and pitch [rad] of each shoe in the base frame, shape (2, N, 3).
        loads: out, normal load of each shoe [N], shape (2, N).
        sinkage: out, `Tracks.sinkage` [m], shape (2,).
        paces: as for `track_slip`; updated.
        speed: out, how fast each belt runs on its machine [m/s], shape (2,).
        strays: out, furthest distance of a shoe from its path [m], shape (2,).
        on_base: out, force [N] and torque about the centre of mass [N m] on the base, shape (6,).
        wrench: out, the same of the ground on shoes and base, shape (6,).
    """
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    count = shoes.shape[1]
    undisturbed_surface, max_sinkage, soils, moistures, table, frame = soil_patch
    area = 0.5 * dimensions.sprocket_radius * dimensions.half_width  # a contact point's
    one = np.zeros(6)
    base_wrench[:] = 0.0
    wrench[:] = 0.0
    for side in range(2):
        y_track = dimensions.half_gauge if side == 0 else -dimensions.half_gauge
        along, running, stray = 0.0, 0, 0.0
        carried, sinking = 0.0, 0.0
        for k in range(count):
            i = side * count + k
            px, py, pz = states[i, 0], states[i, 1], states[i, 2]
            qx, qy, qz, qw = states[i, 3], states[i, 4], states[i, 5], states[i, 6]
            vx, vy, vz = states[i, 7], states[i, 8], states[i, 9]
            wx, wy, wz = states[i, 10], states[i, 11], states[i, 12]
            # Axes of the shoe: the way it goes, across, and out of the track.
            ax, ay, az = (
                1 - 2 * (qy * qy + qz * qz),
                2 * (qx * qy + qw * qz),
                2 * (qx * qz - qw * qy),
            )
            bx, by, bz = (
                2 * (qx * qy - qw * qz),
                1 - 2 * (qx * qx + qz * qz),
                2 * (qy * qz + qw * qx),
            )
            nx, ny, nz = (
                2 * (qx * qz + qw * qy),
                2 * (qy * qz - qw * qx),
                1 - 2 * (qx * qx + qy * qy),
            )
            # From the base: its place and velocity there.
            dx, dy, dz = px - com[0], py - com[1], pz - com[2]
            x = r00 * dx + r10 * dy + r20 * dz + base_com[0]
            y = r01 * dx + r11 * dy + r21 * dz + base_com[1] - y_track
            z = r02 * dx + r12 * dy + r22 * dz + base_com[2]
            cx = velocity[0] + angular_velocity[1] * dz - angular_velocity[2] * dy
            cy = velocity[1] + angular_velocity[2] * dx - angular_velocity[0] * dz
            cz = velocity[2] + angular_velocity[0] * dy - angular_velocity[1] * dx
            ux, uy, uz = vx - cx, vy - cy, vz - cz
            shoes[side, k, 0], shoes[side, k, 1] = x, z
            shoes[side, k, 2] = math.atan2(
                -(r02 * ax + r12 * ay + r22 * az), r00 * ax + r10 * ay + r20 * az
            )
            past = max(abs(x) - dimensions.half_axle_distance, 0.0)
            off = (
                math.sqrt(past * past + (z - dimensions.axle_height) ** 2)
                - dimensions.sprocket_radius
            )
            stray = max(stray, math.sqrt(off * off + y * y))
            if past == 0.0:
                running += 1
                along += ux * ax + uy * ay + uz * az
            fx, fy, fz, borne = _support_force(
                x,
                y,
                z,
                r00 * ux + r10 * uy + r20 * uz,
                r01 * ux + r11 * uy + r21 * uz,
                r02 * ux + r12 * uy + r22 * uz,
                dimensions,
                supports,
                brakes[side],
                brake_anchors,
                side,
                k,
            )
            one[0] = r00 * fx + r01 * fy + r02 * fz
            one[1] = r10 * fx + r11 * fy + r12 * fz
            one[2] = r20 * fx + r21 * fy + r22 * fz
            one[3:] = 0.0
            add_wrench(base_wrench, -one[0], -one[1], -one[2], dx, dy, dz)
            load = 0.0
            for corner in range(4):
                c = 4 * i + corner
                if nz > _MAX_OUTWARD_Z:
                    active[c] = False
                    continue
                u = (
                    _CONTACT_ALONG * dimensions.sprocket_radius
                    if corner & 1
                    else -_CONTACT_ALONG * dimensions.sprocket_radius
                )
                w = (
                    _CONTACT_ACROSS * dimensions.half_width
                    if corner & 2
                    else -_CONTACT_ACROSS * dimensions.half_width
                )
                rx = u * ax + w * bx + dimensions.half_thickness * nx
                ry = u * ay + w * by + dimensions.half_thickness * ny
                rz = u * az + w * bz + dimensions.half_thickness * nz
                fx, fy, fz, part, depth = sole_force(
                    px + rx,
                    py + ry,
                    pz + rz,
                    vx + wy * rz - wz * ry,
                    vy + wz * rx - wx * rz,
                    vz + wx * ry - wy * rx,
                    contact_coefficients,
                    area,
                    undisturbed_surface,
                    max_sinkage,
                    soils,
                    moistures,
                    table,
                    frame,
                    anchors,
                    active,
                    shear_displacement,
                    c,
                )
                if part > 0.0:
                    load += part
                    sinking += part * depth
                    add_wrench(one, fx, fy, fz, rx, ry, rz)
                    add_wrench(wrench, fx, fy, fz, dx + rx, dy + ry, dz + rz)
            carried += load
            if borne and load > 0.0:
                # Damping that would make a light shoe ring acts on the base that rests on it.
                up = max(-supports.sole_damping * (cx * r02 + cy * r12 + cz * r22), -load)
                load += up
                add_wrench(base_wrench, up * r02, up * r12, up * r22, dx, dy, dz)
                add_wrench(wrench, up * r02, up * r12, up * r22, dx, dy, dz)
            loads[side, k] = load
            forces[i] = one
        speed[side] = along / max(running, 1)
        update_mean_speeds(
            mean_speeds,
            side,
            dt,
            speed[side],
            rotation,
            velocity,
            angular_velocity,
            base_com,
            y_track,
        )
        path_deviations[side] = stray
        sinkage[side] = sinking / carried if carried > 0.0 else 0.0
