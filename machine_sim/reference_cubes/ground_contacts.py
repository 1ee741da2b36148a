"""Cubes on the terrain, which changes all the time and therefore is not in pybullet.

Before each step a cube that would enter the live surface is given the velocity with which it does
not: impulses at its eight corners, and under its centre for ridges narrower than the cube, solved
with Coulomb friction for the cube alone. One that is in the surface already comes out at a bounded
speed. What others do to the cube in the coming step is not known here: it is expected to be what
it was in the last one, so that a pile rests on its lowest layer.

Beside a tool that digs cubes are *soft*, as particles are (`particles.soil_contact`): pushed out
gently, never put back.
"""

from __future__ import annotations

import numpy as np

from machine_sim.ground.contact_surface import surface_at
from msg_bridge.kernels import kernel

__all__ = ["finish_ground_contacts", "resolve_ground_contacts"]

_NUM_CONTACT_POINTS = 9
"""Where a cube may touch: its corners and under its centre."""
_NUM_SOLVER_ITERATIONS = 10
"""Times the points of a cube are gone through."""
_RECOVERY_FRACTION = 0.2
"""Part of its depth that a point comes out in a step."""
_MAX_RECOVERY_SPEED, _MAX_LIMITED_RECOVERY_SPEED = 1.0, 0.3
"""Highest speed at which it does, and that of soft cubes [m/s]."""
_SQRT3 = np.sqrt(3.0)


@kernel(forceinline=True)
def _slopes(surface, ground, x, y, reach):  # type: ignore[no-untyped-def]
    """dz/dx and dz/dy across `reach` [m] on each side, past the creases between columns."""
    east = surface_at(surface, ground[0], ground[1], ground[2], x + reach, y)[0]
    west = surface_at(surface, ground[0], ground[1], ground[2], x - reach, y)[0]
    north = surface_at(surface, ground[0], ground[1], ground[2], x, y + reach)[0]
    south = surface_at(surface, ground[0], ground[1], ground[2], x, y - reach)[0]
    return (east - west) / (2.0 * reach), (north - south) / (2.0 * reach)


@kernel
def resolve_ground_contacts(  # type: ignore[no-untyped-def]
    surface, ground, dt, gravity, friction, skip_ground, near_digging_tool, position, quaternion, half,
    contact_delta_velocity, contact_delta_angular_velocity, penetration_limited, velocity, angular_velocity,
):  # fmt: skip
    """Change velocities so that a step of `dt` [s] under gravity leaves cubes upon the ground.

    Args:
        surface, ground: contact surface [m] and `Ground.frame`.
        gravity, friction: [m/s^2] downward; Coulomb coefficient.
        off: who does not feel the ground.
        near: who is beside a tool that digs.
        position, quaternion, half: of the cubes; half edges.
        load, contact_delta_angular_velocity: what others are expected to add to velocity and spin in this step.
        soft: in and out.
        velocity, spin: in and out.
    """
    arm = np.empty((_NUM_CONTACT_POINTS, 3))
    min_normal_speed = np.empty(_NUM_CONTACT_POINTS)
    normal_impulse = np.empty(_NUM_CONTACT_POINTS)
    friction_impulse = np.empty((_NUM_CONTACT_POINTS, 3))
    for i in range(position.shape[0]):
        if skip_ground[i]:
            continue
        h = np.float64(half[i])
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        vx, vy = (
            velocity[i, 0] + contact_delta_velocity[i, 0],
            velocity[i, 1] + contact_delta_velocity[i, 1],
        )
        vz = velocity[i, 2] + contact_delta_velocity[i, 2] - gravity * dt
        above = z - surface_at(surface, ground[0], ground[1], ground[2], x, y)[0]
        penetration_limited[i] = near_digging_tool[i] or (penetration_limited[i] and above < -h)
        slope_x, slope_y = _slopes(surface, ground, x, y, _SQRT3 * h)
        nz = 1.0 / np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        nx, ny = -slope_x * nz, -slope_y * nz
        fastest = _MAX_LIMITED_RECOVERY_SPEED if penetration_limited[i] else _MAX_RECOVERY_SPEED
        reach = dt * (np.sqrt(vx * vx + vy * vy + vz * vz) + 2.0 * h * _norm(angular_velocity, i))
        points = 0
        for p in range(_NUM_CONTACT_POINTS):
            if p < 8:
                bx = h if p & 1 else -h
                by = h if p & 2 else -h
                bz = h if p & 4 else -h
                ax, ay, az = _rotate(quaternion, i, bx, by, bz)
                height = surface_at(surface, ground[0], ground[1], ground[2], x + ax, y + ay)[0]
                gap = (z + az - height) * nz
            else:
                ax, ay, az = 0.0, 0.0, -h
                gap = above - h
            if gap > reach:
                continue
            arm[points, 0], arm[points, 1], arm[points, 2] = ax, ay, az
            min_normal_speed[points] = (
                -gap / dt if gap >= 0.0 else min(-_RECOVERY_FRACTION * gap / dt, fastest)
            )
            normal_impulse[points] = 0.0
            friction_impulse[points, 0] = friction_impulse[points, 1] = friction_impulse[
                points, 2
            ] = 0.0
            points += 1
        if points == 0:
            continue
        wx, wy = (
            angular_velocity[i, 0] + contact_delta_angular_velocity[i, 0],
            angular_velocity[i, 1] + contact_delta_angular_velocity[i, 1],
        )
        wz = angular_velocity[i, 2] + contact_delta_angular_velocity[i, 2]
        # Impulses are per kilogram; a cube's moment of inertia is the same about every axis.
        angular_compliance = 1.5 / (h * h)
        for _ in range(_NUM_SOLVER_ITERATIONS):
            for p in range(points):
                ax, ay, az = arm[p, 0], arm[p, 1], arm[p, 2]
                ux, uy, uz = vx + wy * az - wz * ay, vy + wz * ax - wx * az, vz + wx * ay - wy * ax
                tx, ty, tz = ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx
                un = ux * nx + uy * ny + uz * nz
                old = normal_impulse[p]
                normal_impulse[p] = max(
                    old
                    + (min_normal_speed[p] - un)
                    / (1.0 + angular_compliance * (tx * tx + ty * ty + tz * tz)),
                    0.0,
                )
                j = normal_impulse[p] - old
                vx, vy, vz = vx + j * nx, vy + j * ny, vz + j * nz
                wx, wy, wz = (
                    wx + angular_compliance * j * tx,
                    wy + angular_compliance * j * ty,
                    wz + angular_compliance * j * tz,
                )
                ux, uy, uz = vx + wy * az - wz * ay, vy + wz * ax - wx * az, vz + wx * ay - wy * ax
                un = ux * nx + uy * ny + uz * nz
                share = 1.0 / (1.0 + angular_compliance * (ax * ax + ay * ay + az * az))
                fx = friction_impulse[p, 0] - share * (ux - un * nx)
                fy = friction_impulse[p, 1] - share * (uy - un * ny)
                fz = friction_impulse[p, 2] - share * (uz - un * nz)
                size, limit = np.sqrt(fx * fx + fy * fy + fz * fz), friction * normal_impulse[p]
                if size > limit:
                    fx, fy, fz = fx * limit / size, fy * limit / size, fz * limit / size
                jx, jy, jz = (
                    fx - friction_impulse[p, 0],
                    fy - friction_impulse[p, 1],
                    fz - friction_impulse[p, 2],
                )
                friction_impulse[p, 0], friction_impulse[p, 1], friction_impulse[p, 2] = fx, fy, fz
                vx, vy, vz = vx + jx, vy + jy, vz + jz
                wx += angular_compliance * (ay * jz - az * jy)
                wy += angular_compliance * (az * jx - ax * jz)
                wz += angular_compliance * (ax * jy - ay * jx)
        velocity[i, 0], velocity[i, 1] = (
            vx - contact_delta_velocity[i, 0],
            vy - contact_delta_velocity[i, 1],
        )
        velocity[i, 2] = vz - contact_delta_velocity[i, 2] + gravity * dt
        angular_velocity[i, 0], angular_velocity[i, 1] = (
            wx - contact_delta_angular_velocity[i, 0],
            wy - contact_delta_angular_velocity[i, 1],
        )
        angular_velocity[i, 2] = wz - contact_delta_angular_velocity[i, 2]


@kernel(forceinline=True)
def _norm(vectors, i):  # type: ignore[no-untyped-def]
    x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
    return np.sqrt(np.float64(x * x + y * y + z * z))


@kernel(forceinline=True)
def _rotate(quaternion, i, x, y, z):  # type: ignore[no-untyped-def]
    """A vector of the cube's axes in map axes."""
    a, b, c, w = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
    px, py, pz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return (
        x + w * px + b * pz - c * py,
        y + w * py + c * px - a * pz,
        z + w * pz + a * py - b * px,
    )


@kernel
def finish_ground_contacts(  # type: ignore[no-untyped-def]
    surface,
    ground,
    dt,
    settle_speed,
    skip_ground,
    position,
    velocity,
    angular_velocity,
    half,
    penetration_limited,
    settle_timer,
):
    """Bring back who sank through the ground, and time who is slow on it.

    A centre more than half an edge under the surface is put back upon it at rest. A cube is on the
    ground within half its diagonal, sqrt(3)/2 of its size: the reference's rule (section 3.3.4).

    Returns:
        How many were brought back.
    """
    num_recovered = 0
    for i in range(position.shape[0]):
        slow = _norm(velocity, i) < settle_speed
        if skip_ground[i] or not slow:
            settle_timer[i] = 0.0
        if skip_ground[i]:
            continue
        h = np.float64(half[i])
        x, y = position[i, 0], position[i, 1]
        height = surface_at(surface, ground[0], ground[1], ground[2], x, y)[0]
        slope_x, slope_y = _slopes(surface, ground, x, y, _SQRT3 * h)
        steep = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        distance = (position[i, 2] - height) / steep
        if distance < -h and not penetration_limited[i]:
            position[i, 2] = height + h * steep
            velocity[i, 0] = velocity[i, 1] = velocity[i, 2] = 0.0
            angular_velocity[i, 0] = angular_velocity[i, 1] = angular_velocity[i, 2] = 0.0
            num_recovered += 1
            distance = h
        if distance > _SQRT3 * h:
            settle_timer[i] = 0.0
        elif slow:
            settle_timer[i] += dt
    return num_recovered
