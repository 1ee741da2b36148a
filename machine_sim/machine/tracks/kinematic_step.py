"""Kernel of the fast tracks: belts and their shoes, and a hull that keeps a fallen machine up.

What the ground does to a shoe is in `shoe`. Each corner of the hull carries a spring and
damper along the ground's normal and a bristle along its plane: a spring from the corner to the
anchor where it first touched. Beyond Coulomb's limit the corner slides and drags its anchor along
(Dahl's and LuGre's models reduced to the stiff bristle), as shoes do.
"""

from __future__ import annotations

import math

from machine_sim.ground.contact_surface import surface_at
from machine_sim.machine.tracks.terramechanics import sole_force
from msg_bridge.kernels import kernel

__all__ = [
    "add_hull_contact",
    "add_wrench",
    "contact_point_force",
    "kinematic_track_step",
    "update_mean_speeds",
]

_MEAN_SPEED_TIME = 0.5
"""Over about this long speeds are averaged to tell slip [s]: the chain of hinged tracks runs by
fits and starts."""

_CONTACT_OFFSET = 0.9
"""Where a shoe's two contact points are, in parts of its half width."""

_MAX_OUTWARD_Z = 0.3
"""A shoe whose outside looks up more than this (world z of its normal) touches no ground."""


@kernel(inline="always")
def contact_point_force(  # type: ignore[no-untyped-def]
    px, py, pz, vx, vy, vz, contact_coefficients, ground, frame, anchors, active, i
):
    """Force (fx, fy, fz) and normal load [N] of contact point `i` at p [m] moving with v [m/s]."""
    kn, cn, kt, ct, mu = contact_coefficients
    height, slope_x, slope_y = surface_at(ground, frame[0], frame[1], frame[2], px, py)
    nz = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    depth = (height - pz) * nz
    if not depth > 0.0:
        active[i] = False
        return 0.0, 0.0, 0.0, 0.0
    nx, ny = -slope_x * nz, -slope_y * nz
    vn = vx * nx + vy * ny + vz * nz
    load = kn * depth - cn * vn
    if not load > 0.0:  # it lifts off faster than the soil follows
        active[i] = False
        return 0.0, 0.0, 0.0, 0.0
    if not active[i]:
        active[i] = True
        anchors[i, 0], anchors[i, 1], anchors[i, 2] = px, py, pz
    ux, uy, uz = px - anchors[i, 0], py - anchors[i, 1], pz - anchors[i, 2]
    un = ux * nx + uy * ny + uz * nz
    fx = -kt * (ux - un * nx) - ct * (vx - vn * nx)
    fy = -kt * (uy - un * ny) - ct * (vy - vn * ny)
    fz = -kt * (uz - un * nz) - ct * (vz - vn * nz)
    force, limit = math.sqrt(fx * fx + fy * fy + fz * fz), mu * load
    if force > limit:
        share = limit / force
        fx, fy, fz = share * fx, share * fy, share * fz
        # The anchor follows, so that the spring alone gives the sliding force.
        anchors[i, 0], anchors[i, 1], anchors[i, 2] = px + fx / kt, py + fy / kt, pz + fz / kt
    return fx + load * nx, fy + load * ny, fz + load * nz, load


@kernel(inline="always")
def add_wrench(total, fx, fy, fz, rx, ry, rz):  # type: ignore[no-untyped-def]
    """Add a force at r to a wrench about the origin of r."""
    total[0] += fx
    total[1] += fy
    total[2] += fz
    total[3] += ry * fz - rz * fy
    total[4] += rz * fx - rx * fz
    total[5] += rx * fy - ry * fx


@kernel(inline="always")
def update_mean_speeds(  # type: ignore[no-untyped-def]
    mean_speeds, side, dt, belt, rotation, velocity, angular_velocity, base_com, across
):
    """Let the mean speeds of a belt and of its side over the ground follow the present ones.

    Args:
        paces: of belt and ground [m/s], shape (2, 2); the side's are updated.
        side, dt, belt: number of the side, time step [s], speed of the belt [m/s].
        rotation, velocity, spin, base_com: as for `kinematic_track_step`.
        across: y of the track's middle in the base frame [m].
    """
    ahead = 0.0
    for i in range(3):
        turn = rotation[i, 1] * base_com[2] + rotation[i, 2] * (across - base_com[1])
        ahead += velocity[i] * rotation[i, 0] - angular_velocity[i] * turn
    share = min(dt / _MEAN_SPEED_TIME, 1.0)
    mean_speeds[side, 0] += share * (belt - mean_speeds[side, 0])
    mean_speeds[side, 1] += share * (ahead - mean_speeds[side, 1])


@kernel(inline="always")
def add_hull_contact(  # type: ignore[no-untyped-def]
    com,
    rotation,
    velocity,
    angular_velocity,
    base_com,
    hull,
    swing_cos,
    swing_sin,
    contact_coefficients,
    ground,
    frame,
    anchors,
    active,
    first,
    total,
):
    """Add what the ground does to the corners of the upper body to the wrench `total`.

    Arguments are those of `kinematic_track_step`; the corners' contact points count from `first`.
    """
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    for k in range(hull.shape[0]):
        lx = hull[k, 0] * swing_cos - hull[k, 1] * swing_sin - base_com[0]
        ly = hull[k, 0] * swing_sin + hull[k, 1] * swing_cos - base_com[1]
        lz = hull[k, 2] - base_com[2]
        rx = r00 * lx + r01 * ly + r02 * lz
        ry = r10 * lx + r11 * ly + r12 * lz
        rz = r20 * lx + r21 * ly + r22 * lz
        fx, fy, fz, load = contact_point_force(
            com[0] + rx,
            com[1] + ry,
            com[2] + rz,
            velocity[0] + angular_velocity[1] * rz - angular_velocity[2] * ry,
            velocity[1] + angular_velocity[2] * rx - angular_velocity[0] * rz,
            velocity[2] + angular_velocity[0] * ry - angular_velocity[1] * rx,
            contact_coefficients,
            ground,
            frame,
            anchors,
            active,
            first + k,
        )
        if load > 0.0:
            add_wrench(total, fx, fy, fz, rx, ry, rz)


@kernel(inline="always")
def _belt_path_pose(s, half, radius):  # type: ignore[no-untyped-def]
    """Shoe (x, z, pitch, 1 on an arc) at arc length `s` from under the middle, axle frame.

    The ground run goes backward, then round the rear sprocket, forward on top and down in front.
    """
    arc = math.pi * radius
    if s < half:
        return -s, -radius, math.pi, 0.0
    s -= half
    if s < arc:
        a = s / radius
        return -half - radius * math.sin(a), -radius * math.cos(a), math.pi + a, 1.0
    s -= arc
    if s < 2.0 * half:
        return -half + s, radius, 2.0 * math.pi, 0.0
    s -= 2.0 * half
    if s < arc:
        a = s / radius
        return half + radius * math.sin(a), radius * math.cos(a), 2.0 * math.pi + a, 1.0
    return half - (s - arc), -radius, 3.0 * math.pi, 0.0


@kernel
def kinematic_track_step(  # type: ignore[no-untyped-def]
    dt,
    com,
    rotation,
    velocity,
    angular_velocity,
    base_com,
    hull,
    swing_cos,
    swing_sin,
    shape,
    contact_coefficients,
    drive,
    soil_patch,
    ground,
    command,
    travel,
    speed,
    anchors,
    active,
    shear_displacement,
    shoes,
    loads,
    sinkage,
    mean_speeds,
    wrench,
):
    """Advance both belts by `dt` and find the ground's wrench on the machine.

    Args:
        dt: time step [s].
        com, rotation, velocity, spin: base centre of mass [m], base to map (3, 3), velocity of the
            centre of mass [m/s] and angular velocity [rad/s], map frame.
        base_com: centre of mass in the base frame [m].
        hull: corners of the upper body [m] in the base frame at swing 0, shape (h, 3).
        swing_cos, swing_sin: of the swing angle.
        shape: half axle distance, sprocket radius, half gauge, half shoe width, half shoe
            thickness, axle height [m].
        laws: kn, cn, kt, ct of one contact point and its friction coefficient.
        drive: belt mass [kg], acceleration, braking [m/s^2], traction [N].
        bed: the ground under the shoes.
        ground: contact surface [m], which the hull touches.
        command: wanted belt speeds left, right [m/s].
        travel, speed: belt positions [m] and speeds [m/s], shape (2,); advanced.
        anchors, active, sheared: of the contact points, shapes (n, 3), (n,) and (n,); updated.
            Shoes first, two points each, then the hull.
        shoes: out, x, z [m] and pitch [rad] of each shoe in the base frame, shape (2, N, 3).
        loads: out, normal load of each shoe [N], shape (2, N).
        sinkage: out, `Tracks.sinkage` [m], shape (2,).
        paces: as for `track_slip`; updated.
        wrench: out, force [N] and torque about the centre of mass [N m], map frame, shape (6,).
    """
    half, radius, half_gauge, half_width, half_thick, axle = shape
    mass, acceleration, braking_deceleration, max_tractive_effort = drive
    count = shoes.shape[1]
    length = 4.0 * half + 2.0 * math.pi * radius
    area = length / count * half_width  # a contact point's
    undisturbed_surface, max_sinkage, soils, moistures, table, frame = soil_patch
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    for n in range(6):
        wrench[n] = 0.0
    for side in range(2):
        on_belt, carried, sinking = 0.0, 0.0, 0.0
        y_track = half_gauge if side == 0 else -half_gauge
        for k in range(count):
            s = (travel[side] + k * length / count) % length
            x, z, pitch, round_ = _belt_path_pose(s, half, radius)
            shoes[side, k, 0], shoes[side, k, 1], shoes[side, k, 2] = x, z + axle, pitch
            loads[side, k] = 0.0
            tx, tz = math.cos(pitch), -math.sin(pitch)  # the way the belt moves
            first = (side * count + k) * 2
            if -r20 * tz + r22 * tx > _MAX_OUTWARD_Z:
                active[first] = False
                active[first + 1] = False
                continue
            # Outside of the shoe: its tangent turned by 90 degrees, (-tz, tx).
            lx = x - tz * half_thick - base_com[0]
            lz = z + tx * half_thick + axle - base_com[2]
            # Round a wheel the outside of a shoe is faster than the pitch line.
            belt = speed[side] * (1.0 + round_ * half_thick / radius)
            bx, by, bz = r00 * tx + r02 * tz, r10 * tx + r12 * tz, r20 * tx + r22 * tz
            for end in range(2):
                ly = y_track + (1.0 - 2.0 * end) * _CONTACT_OFFSET * half_width - base_com[1]
                rx = r00 * lx + r01 * ly + r02 * lz
                ry = r10 * lx + r11 * ly + r12 * lz
                rz = r20 * lx + r21 * ly + r22 * lz
                fx, fy, fz, load, depth = sole_force(
                    com[0] + rx,
                    com[1] + ry,
                    com[2] + rz,
                    velocity[0] + angular_velocity[1] * rz - angular_velocity[2] * ry + bx * belt,
                    velocity[1] + angular_velocity[2] * rx - angular_velocity[0] * rz + by * belt,
                    velocity[2] + angular_velocity[0] * ry - angular_velocity[1] * rx + bz * belt,
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
                    first + end,
                )
                if load > 0.0:
                    loads[side, k] += load
                    carried += load
                    sinking += load * depth
                    on_belt += fx * bx + fy * by + fz * bz
                    add_wrench(wrench, fx, fy, fz, rx, ry, rz)
        sinkage[side] = sinking / carried if carried > 0.0 else 0.0
        # The drive wants a speed change and the ground's force made up for, as far as it can.
        change = command[side] - speed[side]
        slower = command[side] * speed[side] <= 0.0 or abs(command[side]) < abs(speed[side])
        most = (braking_deceleration if slower else acceleration) * dt
        change = min(max(change, -most), most)
        effort = min(max(mass * change / dt - on_belt, -max_tractive_effort), max_tractive_effort)
        if abs(effort) < max_tractive_effort:
            speed[side] += change  # exactly, so that a belt told to stop does stop
        else:
            speed[side] += (effort + on_belt) / mass * dt
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
        travel[side] = (travel[side] + speed[side] * dt) % length
    add_hull_contact(
        com,
        rotation,
        velocity,
        angular_velocity,
        base_com,
        hull,
        swing_cos,
        swing_sin,
        contact_coefficients,
        ground,
        soil_patch.frame,
        anchors,
        active,
        4 * count,
        wrench,
    )
