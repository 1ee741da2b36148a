"""Forces of plates on particles, block by block: gather, contact maths in plate axes, scatter."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.contacts.contact_law import contact_force, contact_force_and_moment
from machine_sim.dem.contacts.plate_contacts import BLOCK_SIZE
from machine_sim.dem.contacts.simd import GROUP_SIZE, gather_relative_motion, scatter_forces
from msg_bridge.kernels import kernel

__all__ = ["plate_forces"]

_ADHESION_RUPTURE_GAP = np.float32(0.06)
"""Gap at which a particle sticks to a plate no more, in radii."""
_NUM_SCRATCH_QUANTITIES = 15
"""Quantities of a contact that are needed only within a substep, see `_to_plate`, `_closest`."""
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INSIDE_POLYGON = np.float32(1e30)
"""Squared distance to the outline where the closest point is none of it."""
_TINY = np.float32(1e-20)


@kernel
def plate_forces(blocks, body, force_sums, tools, step, contact_params):  # type: ignore[no-untyped-def]
    """Add the forces of plates to `total` and their reaction to `wrench`.

    Args:
        blocks: `PlateContactBlocks`; springs and sides are updated.
        body, total: see `bodies`.
        tools: `ToolMotion`.
        step: number of the substep.
        law: contact law.
    """
    plates, twist, wrench = tools.plates, tools.twist, tools.wrench
    start, pose = tools.path[0], tools.path[step]
    w = np.empty(_NUM_SCRATCH_QUANTITIES * BLOCK_SIZE, np.float32)
    axes, axes_change, origin_shift = (
        np.empty(9, np.float32),
        np.empty(9, np.float32),
        np.empty(3, np.float32),
    )
    speed = np.empty(6, np.float32)
    for n in range(blocks.plate.size):
        k = blocks.plate[n]
        t, begin, b = tools.tool_of_plate[k], n * BLOCK_SIZE, blocks.block[n]
        filled = (blocks.size[n] + GROUP_SIZE - 1) // GROUP_SIZE * GROUP_SIZE
        for s in range(0, filled, GROUP_SIZE):
            gather_relative_motion(body, blocks.tool_row, blocks.row, begin + s, w, BLOCK_SIZE, s)
        for r in range(3):
            origin_shift[r] = pose[t, 9 + r] - start[t, 9 + r]
            for c in range(3):
                now = _plate_axis_component(plates.frame, k, r, pose[t], c)
                axes[3 * r + c] = now
                axes_change[3 * r + c] = now - _plate_axis_component(
                    plates.frame, k, r, start[t], c
                )
        for c in range(6):
            speed[c] = twist[t, c]
        _transform_to_plate_axes(filled, b, w, axes, axes_change, origin_shift, speed)
        _closest_points(filled, w, plates.corner[k], plates.num_corners[k])
        _evaluate_contacts(filled, b, w, contact_params)
        _transform_to_map_axes(filled, b, w, axes)
        for s in range(0, filled, GROUP_SIZE):
            scatter_forces(
                body, force_sums, blocks.tool_row, blocks.row, begin + s, w, BLOCK_SIZE, s
            )
        for c in range(3):
            force, moment = 0.0, 0.0
            for s in range(blocks.size[n]):
                force += w[s + c * BLOCK_SIZE]
                moment += w[s + (9 + c) * BLOCK_SIZE]
            wrench[t, c] -= force
            wrench[t, 3 + c] -= moment


@kernel(forceinline=True)
def _plate_axis_component(frame, k, r, pose, c):  # type: ignore[no-untyped-def]
    """Component `c`, map axes, of axis `r` of plate `k`: u, v or n."""
    u = 3 + 3 * r
    return (
        pose[3 * c] * frame[k, u]
        + pose[3 * c + 1] * frame[k, u + 1]
        + pose[3 * c + 2] * frame[k, u + 2]
    )


@kernel
def _transform_to_plate_axes(n, b, w, axes, axes_change, origin_shift, twist):  # type: ignore[no-untyped-def]
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
    tux, tuy, tuz = axes_change[0], axes_change[1], axes_change[2]
    tvx, tvy, tvz = axes_change[3], axes_change[4], axes_change[5]
    tnx, tny, tnz = axes_change[6], axes_change[7], axes_change[8]
    px, py, pz = origin_shift[0], origin_shift[1], origin_shift[2]
    sx, sy, sz = twist[0], twist[1], twist[2]
    ox, oy, oz = twist[3], twist[4], twist[5]
    for s in range(np.uint64(n)):
        dx, dy, dz = w[s] - px, w[s + BLOCK_SIZE] - py, w[s + 2 * BLOCK_SIZE] - pz
        qx, qy, qz = b[s + 3 * BLOCK_SIZE], b[s + 4 * BLOCK_SIZE], b[s + 5 * BLOCK_SIZE]
        w[s] = b[s] + (ux * dx + uy * dy + uz * dz) + (tux * qx + tuy * qy + tuz * qz)
        w[s + BLOCK_SIZE] = (
            b[s + BLOCK_SIZE] + (vx * dx + vy * dy + vz * dz) + (tvx * qx + tvy * qy + tvz * qz)
        )
        w[s + 2 * BLOCK_SIZE] = (
            b[s + 2 * BLOCK_SIZE] + (nx * dx + ny * dy + nz * dz) + (tnx * qx + tny * qy + tnz * qz)
        )
        qx, qy, qz = qx + dx, qy + dy, qz + dz
        w[s + 9 * BLOCK_SIZE], w[s + 10 * BLOCK_SIZE], w[s + 11 * BLOCK_SIZE] = qx, qy, qz
        dx = w[s + 3 * BLOCK_SIZE] - sx - (oy * qz - oz * qy)
        dy = w[s + 4 * BLOCK_SIZE] - sy - (oz * qx - ox * qz)
        dz = w[s + 5 * BLOCK_SIZE] - sz - (ox * qy - oy * qx)
        w[s + 3 * BLOCK_SIZE] = ux * dx + uy * dy + uz * dz
        w[s + 4 * BLOCK_SIZE] = vx * dx + vy * dy + vz * dz
        w[s + 5 * BLOCK_SIZE] = nx * dx + ny * dy + nz * dz
        r, ratio = b[s + 6 * BLOCK_SIZE], b[s + 7 * BLOCK_SIZE]
        dx = w[s + 6 * BLOCK_SIZE] * ratio - ox * r
        dy = w[s + 7 * BLOCK_SIZE] * ratio - oy * r
        dz = w[s + 8 * BLOCK_SIZE] * ratio - oz * r
        w[s + 6 * BLOCK_SIZE] = ux * dx + uy * dy + uz * dz
        w[s + 7 * BLOCK_SIZE] = vx * dx + vy * dy + vz * dz
        w[s + 8 * BLOCK_SIZE] = nx * dx + ny * dy + nz * dz


@kernel
def _closest_points(n, w, corner, corners):  # type: ignore[no-untyped-def]
    """Closest points of the plate: squared distance in its plane (12) and the way to it (13, 14).

    As `closest_in_polygon`, edge by edge for all contacts: the closest point lies on an edge that
    the centre is outside of.
    """
    for s in range(np.uint64(n)):
        w[s + 12 * BLOCK_SIZE] = _INSIDE_POLYGON
        w[s + 13 * BLOCK_SIZE] = _ZERO
        w[s + 14 * BLOCK_SIZE] = _ZERO
    for e in range(corners):
        f = e + 1 if e + 1 < corners else 0
        a, b = np.float32(corner[e, 0]), np.float32(corner[e, 1])
        ea = np.float32(corner[f, 0] - corner[e, 0])
        eb = np.float32(corner[f, 1] - corner[e, 1])
        inverse = _ONE / (ea * ea + eb * eb)
        for s in range(np.uint64(n)):
            pa, pb = w[s] - a, w[s + BLOCK_SIZE] - b
            along = min(max((pa * ea + pb * eb) * inverse, _ZERO), _ONE)
            da, db = pa - along * ea, pb - along * eb
            square = da * da + db * db
            nearer = (ea * pb - eb * pa < _ZERO) & (square < w[s + 12 * BLOCK_SIZE])
            w[s + 12 * BLOCK_SIZE] = square if nearer else w[s + 12 * BLOCK_SIZE]
            w[s + 13 * BLOCK_SIZE] = da if nearer else w[s + 13 * BLOCK_SIZE]
            w[s + 14 * BLOCK_SIZE] = db if nearer else w[s + 14 * BLOCK_SIZE]


@kernel
def _evaluate_contacts(n, b, w, contact_params):  # type: ignore[no-untyped-def]
    """From places and motion to forces, in plate axes.

    Out: force on the particle (0-2), its moment about the centre over the radius (3-5), share of
    the rolling limit (6).
    """
    for s in range(np.uint64(n)):
        h, r = w[s + 2 * BLOCK_SIZE], b[s + 6 * BLOCK_SIZE]
        inside = w[s + 12 * BLOCK_SIZE] == _INSIDE_POLYGON
        above = _ONE if h >= _ZERO else -_ONE
        side = b[s + 15 * BLOCK_SIZE] if inside else above
        da, db = w[s + 13 * BLOCK_SIZE], w[s + 14 * BLOCK_SIZE]
        distance = np.sqrt(da * da + db * db + h * h + _TINY)
        inverse = _ONE / distance
        nx, ny = da * inverse, db * inverse
        nz = side if inside else h * inverse
        overlap = r - (h * side if inside else distance)
        # What holds it to the plate fades over a small gap.
        cohesion_force = b[s + 11 * BLOCK_SIZE] * min(
            max(_ONE + overlap / (_ADHESION_RUPTURE_GAP * r), _ZERO), _ONE
        )
        touches = _ONE if overlap > _ZERO else _ZERO
        ax, ay, az = w[s + 6 * BLOCK_SIZE], w[s + 7 * BLOCK_SIZE], w[s + 8 * BLOCK_SIZE]
        # The point that touches is a radius from the centre, and goes round with the spin.
        normal_force, gx, gy, gz, sx, sy, sz = contact_force(
            contact_params, b[s + 9 * BLOCK_SIZE], overlap, nx, ny, nz,
            w[s + 3 * BLOCK_SIZE] - (ay * nz - az * ny),
            w[s + 4 * BLOCK_SIZE] - (az * nx - ax * nz),
            w[s + 5 * BLOCK_SIZE] - (ax * ny - ay * nx),
            b[s + 12 * BLOCK_SIZE], b[s + 13 * BLOCK_SIZE], b[s + 14 * BLOCK_SIZE],
        )  # fmt: skip
        b[s + 12 * BLOCK_SIZE] = sx * touches
        b[s + 13 * BLOCK_SIZE] = sy * touches
        b[s + 14 * BLOCK_SIZE] = sz * touches
        b[s + 15 * BLOCK_SIZE] = side
        fx, fy, fz, tx, ty, tz, normal_force = contact_force_and_moment(
            b[s + 8 * BLOCK_SIZE] * touches, cohesion_force, normal_force, gx, gy, gz, nx, ny, nz
        )
        w[s], w[s + BLOCK_SIZE], w[s + 2 * BLOCK_SIZE] = fx, fy, fz
        w[s + 3 * BLOCK_SIZE], w[s + 4 * BLOCK_SIZE], w[s + 5 * BLOCK_SIZE] = tx, ty, tz
        w[s + 6 * BLOCK_SIZE] = normal_force * b[s + 10 * BLOCK_SIZE]


@kernel
def _transform_to_map_axes(n, b, w, axes):  # type: ignore[no-untyped-def]
    """Forces (0-2) and turning forces (3-5) to map axes; moment about the tool's origin (9-11)."""
    ux, uy, uz = axes[0], axes[1], axes[2]
    vx, vy, vz = axes[3], axes[4], axes[5]
    nx, ny, nz = axes[6], axes[7], axes[8]
    for s in range(np.uint64(n)):
        a, c, h = w[s], w[s + BLOCK_SIZE], w[s + 2 * BLOCK_SIZE]
        fx = a * ux + c * vx + h * nx
        fy = a * uy + c * vy + h * ny
        fz = a * uz + c * vz + h * nz
        w[s], w[s + BLOCK_SIZE], w[s + 2 * BLOCK_SIZE] = fx, fy, fz
        a, c, h = w[s + 3 * BLOCK_SIZE], w[s + 4 * BLOCK_SIZE], w[s + 5 * BLOCK_SIZE]
        tx = a * ux + c * vx + h * nx
        ty = a * uy + c * vy + h * ny
        tz = a * uz + c * vz + h * nz
        r, ratio = b[s + 6 * BLOCK_SIZE], b[s + 7 * BLOCK_SIZE]
        w[s + 3 * BLOCK_SIZE] = tx * ratio
        w[s + 4 * BLOCK_SIZE] = ty * ratio
        w[s + 5 * BLOCK_SIZE] = tz * ratio
        qx, qy, qz = w[s + 9 * BLOCK_SIZE], w[s + 10 * BLOCK_SIZE], w[s + 11 * BLOCK_SIZE]
        w[s + 9 * BLOCK_SIZE] = qy * fz - qz * fy + r * tx
        w[s + 10 * BLOCK_SIZE] = qz * fx - qx * fz + r * ty
        w[s + 11 * BLOCK_SIZE] = qx * fy - qy * fx + r * tz
