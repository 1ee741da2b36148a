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

from machine_sim.ground import surface_at
from machine_sim.jit import inline_kernel, kernel

__all__ = ["finish_on_ground", "stand_on_ground"]

_POINTS = 9
"""Where a cube may touch: its corners and under its centre."""
_SWEEPS = 10
"""Times the points of a cube are gone through."""
_RECOVERY = 0.2
"""Part of its depth that a point comes out in a step."""
_FASTEST, _SOFT_FASTEST = 1.0, 0.3
"""Highest speed at which it does, and that of soft cubes [m/s]."""
_SQRT3 = np.sqrt(3.0)


@inline_kernel
def _slopes(surface, ground, x, y, reach):  # type: ignore[no-untyped-def]
    """dz/dx and dz/dy across `reach` [m] on each side, past the creases between columns."""
    east = surface_at(surface, ground[0], ground[1], ground[2], x + reach, y)[0]
    west = surface_at(surface, ground[0], ground[1], ground[2], x - reach, y)[0]
    north = surface_at(surface, ground[0], ground[1], ground[2], x, y + reach)[0]
    south = surface_at(surface, ground[0], ground[1], ground[2], x, y - reach)[0]
    return (east - west) / (2.0 * reach), (north - south) / (2.0 * reach)


@kernel
def stand_on_ground(  # type: ignore[no-untyped-def]
    surface, ground, dt, gravity, friction, off, near, position, quaternion, half,
    load, load_spin, soft, velocity, spin,
):  # fmt: skip
    """Change velocities so that a step of `dt` [s] under gravity leaves cubes upon the ground.

    Args:
        surface, ground: contact surface [m] and `Ground.frame`.
        gravity, friction: [m/s^2] downward; Coulomb coefficient.
        off: who does not feel the ground.
        near: who is beside a tool that digs.
        position, quaternion, half: of the cubes; half edges.
        load, load_spin: what others are expected to add to velocity and spin in this step.
        soft: in and out.
        velocity, spin: in and out.
    """
    arm = np.empty((_POINTS, 3))
    least = np.empty(_POINTS)
    push = np.empty(_POINTS)
    rub = np.empty((_POINTS, 3))
    for i in range(position.shape[0]):
        if off[i]:
            continue
        h = np.float64(half[i])
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        vx, vy = velocity[i, 0] + load[i, 0], velocity[i, 1] + load[i, 1]
        vz = velocity[i, 2] + load[i, 2] - gravity * dt
        above = z - surface_at(surface, ground[0], ground[1], ground[2], x, y)[0]
        soft[i] = near[i] or (soft[i] and above < -h)
        slope_x, slope_y = _slopes(surface, ground, x, y, _SQRT3 * h)
        nz = 1.0 / np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        nx, ny = -slope_x * nz, -slope_y * nz
        fastest = _SOFT_FASTEST if soft[i] else _FASTEST
        reach = dt * (np.sqrt(vx * vx + vy * vy + vz * vz) + 2.0 * h * _norm(spin, i))
        points = 0
        for p in range(_POINTS):
            if p < 8:
                bx = h if p & 1 else -h
                by = h if p & 2 else -h
                bz = h if p & 4 else -h
                ax, ay, az = _turned(quaternion, i, bx, by, bz)
                height = surface_at(surface, ground[0], ground[1], ground[2], x + ax, y + ay)[0]
                gap = (z + az - height) * nz
            else:
                ax, ay, az = 0.0, 0.0, -h
                gap = above - h
            if gap > reach:
                continue
            arm[points, 0], arm[points, 1], arm[points, 2] = ax, ay, az
            least[points] = -gap / dt if gap >= 0.0 else min(-_RECOVERY * gap / dt, fastest)
            push[points] = 0.0
            rub[points, 0] = rub[points, 1] = rub[points, 2] = 0.0
            points += 1
        if points == 0:
            continue
        wx, wy = spin[i, 0] + load_spin[i, 0], spin[i, 1] + load_spin[i, 1]
        wz = spin[i, 2] + load_spin[i, 2]
        # Impulses are per kilogram; a cube's moment of inertia is the same about every axis.
        ease = 1.5 / (h * h)
        for _ in range(_SWEEPS):
            for p in range(points):
                ax, ay, az = arm[p, 0], arm[p, 1], arm[p, 2]
                ux, uy, uz = vx + wy * az - wz * ay, vy + wz * ax - wx * az, vz + wx * ay - wy * ax
                tx, ty, tz = ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx
                un = ux * nx + uy * ny + uz * nz
                old = push[p]
                push[p] = max(
                    old + (least[p] - un) / (1.0 + ease * (tx * tx + ty * ty + tz * tz)), 0.0
                )
                j = push[p] - old
                vx, vy, vz = vx + j * nx, vy + j * ny, vz + j * nz
                wx, wy, wz = wx + ease * j * tx, wy + ease * j * ty, wz + ease * j * tz
                ux, uy, uz = vx + wy * az - wz * ay, vy + wz * ax - wx * az, vz + wx * ay - wy * ax
                un = ux * nx + uy * ny + uz * nz
                share = 1.0 / (1.0 + ease * (ax * ax + ay * ay + az * az))
                fx = rub[p, 0] - share * (ux - un * nx)
                fy = rub[p, 1] - share * (uy - un * ny)
                fz = rub[p, 2] - share * (uz - un * nz)
                size, limit = np.sqrt(fx * fx + fy * fy + fz * fz), friction * push[p]
                if size > limit:
                    fx, fy, fz = fx * limit / size, fy * limit / size, fz * limit / size
                jx, jy, jz = fx - rub[p, 0], fy - rub[p, 1], fz - rub[p, 2]
                rub[p, 0], rub[p, 1], rub[p, 2] = fx, fy, fz
                vx, vy, vz = vx + jx, vy + jy, vz + jz
                wx += ease * (ay * jz - az * jy)
                wy += ease * (az * jx - ax * jz)
                wz += ease * (ax * jy - ay * jx)
        velocity[i, 0], velocity[i, 1] = vx - load[i, 0], vy - load[i, 1]
        velocity[i, 2] = vz - load[i, 2] + gravity * dt
        spin[i, 0], spin[i, 1] = wx - load_spin[i, 0], wy - load_spin[i, 1]
        spin[i, 2] = wz - load_spin[i, 2]


@inline_kernel
def _norm(vectors, i):  # type: ignore[no-untyped-def]
    x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
    return np.sqrt(np.float64(x * x + y * y + z * z))


@inline_kernel
def _turned(quaternion, i, x, y, z):  # type: ignore[no-untyped-def]
    """A vector of the cube's axes in map axes."""
    a, b, c, w = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
    px, py, pz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return (
        x + w * px + b * pz - c * py,
        y + w * py + c * px - a * pz,
        z + w * pz + a * py - b * px,
    )


@kernel
def finish_on_ground(  # type: ignore[no-untyped-def]
    surface, ground, dt, settle_speed, off, position, velocity, spin, half, soft, quiet_time
):
    """Bring back who sank through the ground, and time who is slow on it.

    A centre more than half an edge under the surface is put back upon it at rest. A cube is on the
    ground within half its diagonal, sqrt(3)/2 of its size: the reference's rule (section 3.3.4).

    Returns:
        How many were brought back.
    """
    rescued = 0
    for i in range(position.shape[0]):
        slow = _norm(velocity, i) < settle_speed
        if off[i] or not slow:
            quiet_time[i] = 0.0
        if off[i]:
            continue
        h = np.float64(half[i])
        x, y = position[i, 0], position[i, 1]
        height = surface_at(surface, ground[0], ground[1], ground[2], x, y)[0]
        slope_x, slope_y = _slopes(surface, ground, x, y, _SQRT3 * h)
        steep = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        distance = (position[i, 2] - height) / steep
        if distance < -h and not soft[i]:
            position[i, 2] = height + h * steep
            velocity[i, 0] = velocity[i, 1] = velocity[i, 2] = 0.0
            spin[i, 0] = spin[i, 1] = spin[i, 2] = 0.0
            rescued += 1
            distance = h
        if distance > _SQRT3 * h:
            quiet_time[i] = 0.0
        elif slow:
            quiet_time[i] += dt
    return rescued
