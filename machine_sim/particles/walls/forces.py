"""Forces of plates on particles, block by block: gather, contact maths in plate axes, scatter."""

from __future__ import annotations

import numpy as np

from machine_sim.jit import inline_kernel, kernel
from machine_sim.particles.law import contact_force, contact_sums
from machine_sim.particles.pairs.simd import GROUP, gather_motion, scatter_forces
from machine_sim.particles.walls.contacts import BLOCK

__all__ = ["wall_forces"]

_BOND_GAP = np.float32(0.06)
"""Gap at which a particle sticks to a plate no more, in radii."""
_SCRATCH = 15
"""Quantities of a contact that are needed only within a substep, see `_to_plate`, `_closest`."""
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INSIDE = np.float32(1e30)
"""Squared distance to the outline where the closest point is none of it."""
_TINY = np.float32(1e-20)


@kernel
def wall_forces(blocks, body, total, tools, step, law):  # type: ignore[no-untyped-def]
    """Add the forces of plates to `total` and their reaction to `wrench`.

    Args:
        blocks: `WallBlocks`; springs and sides are updated.
        body, total: see `bodies`.
        tools: `ToolMotion`.
        step: number of the substep.
        law: contact law.
    """
    plates, twist, wrench = tools.plates, tools.twist, tools.wrench
    start, pose = tools.path[0], tools.path[step]
    w = np.empty(_SCRATCH * BLOCK, np.float32)
    axes, turned, shift = np.empty(9, np.float32), np.empty(9, np.float32), np.empty(3, np.float32)
    speed = np.empty(6, np.float32)
    for n in range(blocks.plate.size):
        k = blocks.plate[n]
        t, begin, b = tools.owner[k], n * BLOCK, blocks.block[n]
        filled = (blocks.size[n] + GROUP - 1) // GROUP * GROUP
        for s in range(0, filled, GROUP):
            gather_motion(body, blocks.tool_row, blocks.row, begin + s, w, BLOCK, s)
        for r in range(3):
            shift[r] = pose[t, 9 + r] - start[t, 9 + r]
            for c in range(3):
                now = _along(plates.frame, k, r, pose[t], c)
                axes[3 * r + c] = now
                turned[3 * r + c] = now - _along(plates.frame, k, r, start[t], c)
        for c in range(6):
            speed[c] = twist[t, c]
        _to_plate(filled, b, w, axes, turned, shift, speed)
        _closest(filled, w, plates.corner[k], plates.corners[k])
        _contact_maths(filled, b, w, law)
        _to_map(filled, b, w, axes)
        for s in range(0, filled, GROUP):
            scatter_forces(body, total, blocks.tool_row, blocks.row, begin + s, w, BLOCK, s)
        for c in range(3):
            force, moment = 0.0, 0.0
            for s in range(blocks.size[n]):
                force += w[s + c * BLOCK]
                moment += w[s + (9 + c) * BLOCK]
            wrench[t, c] -= force
            wrench[t, 3 + c] -= moment


@inline_kernel
def _along(frame, k, r, pose, c):  # type: ignore[no-untyped-def]
    """Component `c`, map axes, of axis `r` of plate `k`: u, v or n."""
    u = 3 + 3 * r
    return (
        pose[3 * c] * frame[k, u]
        + pose[3 * c + 1] * frame[k, u + 1]
        + pose[3 * c + 2] * frame[k, u + 2]
    )


@kernel
def _to_plate(n, b, w, axes, turned, shift, twist):  # type: ignore[no-untyped-def]
    """From motion in map axes to motion seen from the plate, in its axes.

    In: displacement (0-2), velocity (3-5), surface speed at the contact radius (6-8). Out: place of
    the centre (0-2), its velocity relative to the tool there (3-5), surface speed relative to the
    tool's spin (6-8), all in plate axes; arm from the tool's origin (9-11), map axes.

    Args:
        axes: u, v, n of the plate now, map axes, shape (9,).
        turned, shift: how these, and the tool's origin [m], have changed in the step.
        twist: of the tool.
    """
    ux, uy, uz = axes[0], axes[1], axes[2]
    vx, vy, vz = axes[3], axes[4], axes[5]
    nx, ny, nz = axes[6], axes[7], axes[8]
    # The turn of the plate within the step is small, and float32 exact enough for what it adds.
    tux, tuy, tuz = turned[0], turned[1], turned[2]
    tvx, tvy, tvz = turned[3], turned[4], turned[5]
    tnx, tny, tnz = turned[6], turned[7], turned[8]
    px, py, pz = shift[0], shift[1], shift[2]
    sx, sy, sz = twist[0], twist[1], twist[2]
    ox, oy, oz = twist[3], twist[4], twist[5]
    for s in range(np.uint64(n)):
        dx, dy, dz = w[s] - px, w[s + BLOCK] - py, w[s + 2 * BLOCK] - pz
        qx, qy, qz = b[s + 3 * BLOCK], b[s + 4 * BLOCK], b[s + 5 * BLOCK]
        w[s] = b[s] + (ux * dx + uy * dy + uz * dz) + (tux * qx + tuy * qy + tuz * qz)
        w[s + BLOCK] = (
            b[s + BLOCK] + (vx * dx + vy * dy + vz * dz) + (tvx * qx + tvy * qy + tvz * qz)
        )
        w[s + 2 * BLOCK] = (
            b[s + 2 * BLOCK] + (nx * dx + ny * dy + nz * dz) + (tnx * qx + tny * qy + tnz * qz)
        )
        qx, qy, qz = qx + dx, qy + dy, qz + dz
        w[s + 9 * BLOCK], w[s + 10 * BLOCK], w[s + 11 * BLOCK] = qx, qy, qz
        dx = w[s + 3 * BLOCK] - sx - (oy * qz - oz * qy)
        dy = w[s + 4 * BLOCK] - sy - (oz * qx - ox * qz)
        dz = w[s + 5 * BLOCK] - sz - (ox * qy - oy * qx)
        w[s + 3 * BLOCK] = ux * dx + uy * dy + uz * dz
        w[s + 4 * BLOCK] = vx * dx + vy * dy + vz * dz
        w[s + 5 * BLOCK] = nx * dx + ny * dy + nz * dz
        r, ratio = b[s + 6 * BLOCK], b[s + 7 * BLOCK]
        dx = w[s + 6 * BLOCK] * ratio - ox * r
        dy = w[s + 7 * BLOCK] * ratio - oy * r
        dz = w[s + 8 * BLOCK] * ratio - oz * r
        w[s + 6 * BLOCK] = ux * dx + uy * dy + uz * dz
        w[s + 7 * BLOCK] = vx * dx + vy * dy + vz * dz
        w[s + 8 * BLOCK] = nx * dx + ny * dy + nz * dz


@kernel
def _closest(n, w, corner, corners):  # type: ignore[no-untyped-def]
    """Closest points of the plate: squared distance in its plane (12) and the way to it (13, 14).

    As `closest_in_polygon`, edge by edge for all contacts: the closest point lies on an edge that
    the centre is outside of.
    """
    for s in range(np.uint64(n)):
        w[s + 12 * BLOCK] = _INSIDE
        w[s + 13 * BLOCK] = _ZERO
        w[s + 14 * BLOCK] = _ZERO
    for e in range(corners):
        f = e + 1 if e + 1 < corners else 0
        a, b = np.float32(corner[e, 0]), np.float32(corner[e, 1])
        ea = np.float32(corner[f, 0] - corner[e, 0])
        eb = np.float32(corner[f, 1] - corner[e, 1])
        inverse = _ONE / (ea * ea + eb * eb)
        for s in range(np.uint64(n)):
            pa, pb = w[s] - a, w[s + BLOCK] - b
            along = min(max((pa * ea + pb * eb) * inverse, _ZERO), _ONE)
            da, db = pa - along * ea, pb - along * eb
            square = da * da + db * db
            nearer = (ea * pb - eb * pa < _ZERO) & (square < w[s + 12 * BLOCK])
            w[s + 12 * BLOCK] = square if nearer else w[s + 12 * BLOCK]
            w[s + 13 * BLOCK] = da if nearer else w[s + 13 * BLOCK]
            w[s + 14 * BLOCK] = db if nearer else w[s + 14 * BLOCK]


@kernel
def _contact_maths(n, b, w, law):  # type: ignore[no-untyped-def]
    """From places and motion to forces, in plate axes.

    Out: force on the particle (0-2), its moment about the centre over the radius (3-5), share of
    the rolling limit (6).
    """
    for s in range(np.uint64(n)):
        h, r = w[s + 2 * BLOCK], b[s + 6 * BLOCK]
        inside = w[s + 12 * BLOCK] == _INSIDE
        above = _ONE if h >= _ZERO else -_ONE
        side = b[s + 15 * BLOCK] if inside else above
        da, db = w[s + 13 * BLOCK], w[s + 14 * BLOCK]
        distance = np.sqrt(da * da + db * db + h * h + _TINY)
        inverse = _ONE / distance
        nx, ny = da * inverse, db * inverse
        nz = side if inside else h * inverse
        overlap = r - (h * side if inside else distance)
        # What holds it to the plate fades over a small gap.
        hold = b[s + 11 * BLOCK] * min(max(_ONE + overlap / (_BOND_GAP * r), _ZERO), _ONE)
        touches = _ONE if overlap > _ZERO else _ZERO
        ax, ay, az = w[s + 6 * BLOCK], w[s + 7 * BLOCK], w[s + 8 * BLOCK]
        # The point that touches is a radius from the centre, and goes round with the spin.
        push, gx, gy, gz, sx, sy, sz = contact_force(
            law, b[s + 9 * BLOCK], overlap, nx, ny, nz,
            w[s + 3 * BLOCK] - (ay * nz - az * ny),
            w[s + 4 * BLOCK] - (az * nx - ax * nz),
            w[s + 5 * BLOCK] - (ax * ny - ay * nx),
            b[s + 12 * BLOCK], b[s + 13 * BLOCK], b[s + 14 * BLOCK],
        )  # fmt: skip
        b[s + 12 * BLOCK] = sx * touches
        b[s + 13 * BLOCK] = sy * touches
        b[s + 14 * BLOCK] = sz * touches
        b[s + 15 * BLOCK] = side
        fx, fy, fz, tx, ty, tz, push = contact_sums(
            b[s + 8 * BLOCK] * touches, hold, push, gx, gy, gz, nx, ny, nz
        )
        w[s], w[s + BLOCK], w[s + 2 * BLOCK] = fx, fy, fz
        w[s + 3 * BLOCK], w[s + 4 * BLOCK], w[s + 5 * BLOCK] = tx, ty, tz
        w[s + 6 * BLOCK] = push * b[s + 10 * BLOCK]


@kernel
def _to_map(n, b, w, axes):  # type: ignore[no-untyped-def]
    """Forces (0-2) and turning forces (3-5) to map axes; moment about the tool's origin (9-11)."""
    ux, uy, uz = axes[0], axes[1], axes[2]
    vx, vy, vz = axes[3], axes[4], axes[5]
    nx, ny, nz = axes[6], axes[7], axes[8]
    for s in range(np.uint64(n)):
        a, c, h = w[s], w[s + BLOCK], w[s + 2 * BLOCK]
        fx = a * ux + c * vx + h * nx
        fy = a * uy + c * vy + h * ny
        fz = a * uz + c * vz + h * nz
        w[s], w[s + BLOCK], w[s + 2 * BLOCK] = fx, fy, fz
        a, c, h = w[s + 3 * BLOCK], w[s + 4 * BLOCK], w[s + 5 * BLOCK]
        tx = a * ux + c * vx + h * nx
        ty = a * uy + c * vy + h * ny
        tz = a * uz + c * vz + h * nz
        r, ratio = b[s + 6 * BLOCK], b[s + 7 * BLOCK]
        w[s + 3 * BLOCK] = tx * ratio
        w[s + 4 * BLOCK] = ty * ratio
        w[s + 5 * BLOCK] = tz * ratio
        qx, qy, qz = w[s + 9 * BLOCK], w[s + 10 * BLOCK], w[s + 11 * BLOCK]
        w[s + 9 * BLOCK] = qy * fz - qz * fy + r * tx
        w[s + 10 * BLOCK] = qz * fx - qx * fz + r * ty
        w[s + 11 * BLOCK] = qx * fy - qy * fx + r * tz
