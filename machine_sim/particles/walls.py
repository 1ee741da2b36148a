"""Particles at tool plates: which may touch within the step, the forces, and who got through.

Each contact remembers on which side of its plate the particle is. The side changes only around
the plate's edge: a centre pressed through the middle of a plate is still pushed back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.particles.jit import inline_kernel, kernel
from machine_sim.particles.law import contact_force
from machine_sim.particles.plates import closest_in_polygon, plate_coordinates
from machine_sim.particles.store import ParticleStore
from machine_sim.particles.tool import ToolSet

__all__ = ["WallList", "wall_forces"]

_BOND_GAP = 0.06
"""Gap at which a particle sticks to a plate no more, in radii."""

_LEAST_AT_PLATE = np.float32(0.5)
"""Smallest radius a plate feels, in full radii. One released into a crowd starts as a point, and
its neighbours would press a point through a plate."""
_REACH = 1.2
"""How far plates are listed from a particle that does not move, in radii."""


class WallTable:
    """Particle-plate contacts in order of rows, then plates.

    Attributes:
        row, plate: of each contact, int64.
        spring: tangential spring [m], tool frame, shape (room, 3).
        side: +1 or -1, the side of the plate's normal.
        begin, end: contacts of each row, shape (n,).
        count: number of contacts.
    """

    def __init__(self, room: int, rows: int) -> None:
        self.row = np.zeros(room, np.int64)
        self.plate = np.zeros(room, np.int64)
        self.spring = np.zeros((room, 3), np.float32)
        self.side = np.zeros(room, np.float32)
        self.begin = np.zeros(rows, np.int64)
        self.end = np.zeros(rows, np.int64)
        self.count = 0

    @property
    def plates(self) -> NDArray[np.int64]:
        """Plate of each contact, shape (count,)."""
        return self.plate[: self.count]


class WallList:
    """The contact table, listed anew each step with its history carried over."""

    def __init__(self) -> None:
        self.table = WallTable(1024, 0)
        self._spare = WallTable(1024, 0)

    def refresh(self, store: ParticleStore, rows, tools: ToolSet, dt: float) -> None:  # type: ignore[no-untyped-def]
        """List all plates that one of `rows` may touch within the next `dt` [s]."""
        old = self.table
        if not tools.tools:
            old.count = 0
            return
        while True:
            new = self._spare
            if len(new.begin) < store.count:
                new.begin = np.zeros(2 * store.count, np.int64)
                new.end = np.zeros(2 * store.count, np.int64)
            new.count = _list_walls(
                dt, rows, store.position, store.velocity, store.radius, store.wall_row,
                tools.frame, tools.corner, tools.corners, tools.first, tools.sphere,
                tools.path[0], tools.twist,
                old.plate, old.spring, old.side, old.begin, old.end,
                new.row, new.plate, new.spring, new.side, new.begin, new.end,
            )  # fmt: skip
            if new.count >= 0:
                break
            self._spare = WallTable(2 * len(new.row), 0)
        self.table, self._spare = new, old
        store.wall_row[:] = -1
        store.wall_row[rows] = rows

    def drop(self, low: int, high: int) -> None:
        """Forget plates number `low` to below `high`; those behind move up."""
        plate = self.table.plate[: self.table.count]
        gone = (plate >= low) & (plate < high)
        plate[plate >= high] -= high - low
        plate[gone] = -1

    def crossed(
        self,
        store: ParticleStore,
        rows: NDArray[np.int64],
        tools: ToolSet,
        before: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """Which of `rows` went through a plate in this step, in the frame of the moving tool.

        Args:
            store: the particles.
            rows: who moved.
            tools: what may have been gone through.
            before: their centres at the start of the step [m], map frame, shape (rows, 3).
        """
        through = np.zeros(rows.size, np.bool_)
        if tools.tools:
            table = self.table
            _crossings(
                rows, before, store.position, store.radius,
                tools.frame, tools.corner, tools.corners, tools.owner, tools.first, tools.sphere,
                tools.path[0], tools.path[-1],
                table.plate, table.side, table.begin, table.end, through,
            )  # fmt: skip
        return through


@inline_kernel
def to_tool(pose, x, y, z):  # type: ignore[no-untyped-def]
    """A point [m] of the map frame in the frame of a packed pose."""
    return turn_back(pose, x - pose[9], y - pose[10], z - pose[11])


@inline_kernel
def turn_back(pose, x, y, z):  # type: ignore[no-untyped-def]
    """A vector of map axes in the axes of a packed pose."""
    return (
        pose[0] * x + pose[3] * y + pose[6] * z,
        pose[1] * x + pose[4] * y + pose[7] * z,
        pose[2] * x + pose[5] * y + pose[8] * z,
    )


@kernel
def _list_walls(  # type: ignore[no-untyped-def]
    dt, rows, position, velocity, radius, old_row,
    frame, corner, corners, first_plate, sphere, pose, twist,
    old_plate, old_spring, old_side, old_begin, old_end,
    row, plate, spring, side, begin, end,
):  # fmt: skip
    """Fill the table; returns the number of contacts, -1 where it is too small."""
    count = 0
    for i in rows:
        begin[i] = count
        for t in range(pose.shape[0]):
            qx, qy, qz = (
                position[i, 0] - pose[t, 9],
                position[i, 1] - pose[t, 10],
                position[i, 2] - pose[t, 11],
            )
            vx = velocity[i, 0] - twist[t, 0] - (twist[t, 4] * qz - twist[t, 5] * qy)
            vy = velocity[i, 1] - twist[t, 1] - (twist[t, 5] * qx - twist[t, 3] * qz)
            vz = velocity[i, 2] - twist[t, 2] - (twist[t, 3] * qy - twist[t, 4] * qx)
            speed = np.sqrt(vx * vx + vy * vy + vz * vz)
            reach = _REACH * radius[i] + 1.3 * speed * dt
            x, y, z = turn_back(pose[t], qx, qy, qz)
            cx, cy, cz = x - sphere[t, 0], y - sphere[t, 1], z - sphere[t, 2]
            if cx * cx + cy * cy + cz * cz > (sphere[t, 3] + reach) ** 2:
                continue
            for k in range(first_plate[t], first_plate[t + 1]):
                a, b, h = plate_coordinates(frame, k, x, y, z)
                if abs(h) > reach:
                    continue
                ca, cb, _ = closest_in_polygon(corner, corners, k, a, b)
                if (a - ca) ** 2 + (b - cb) ** 2 + h * h > reach * reach:
                    continue
                if count == row.size:
                    return -1
                row[count], plate[count] = i, k
                side[count] = np.float32(1.0) if h >= 0.0 else np.float32(-1.0)
                for axis in range(3):
                    spring[count, axis] = np.float32(0.0)
                if old_row[i] >= 0:
                    for m in range(old_begin[old_row[i]], old_end[old_row[i]]):
                        if old_plate[m] == k:
                            side[count] = old_side[m]
                            for axis in range(3):
                                spring[count, axis] = old_spring[m, axis]
                count += 1
        end[i] = count
    return count


@kernel
def wall_forces(  # type: ignore[no-untyped-def]
    count, row, plate, spring, side, position, mass, radius, friction, rolling, adhesion,
    body, total, frame, corner, corners, owner, pose, twist, wrench, law,
):  # fmt: skip
    """Add the forces of plates to `total` and their reaction to `wrench`.

    Contacts are worked out in tool axes, where the spring turns with the tool.

    Args:
        count, row, plate, spring, side: the table; spring and side are updated.
        position, mass, radius: of the particles at the start of the step, by row.
        friction, rolling, adhesion: at a tool: coefficients, and bond pressure [Pa], by row.
        body, total: see `bodies`.
        frame, corner, corners, owner, twist, wrench: of `ToolSet`.
        pose: packed poses at this substep, shape (tools, 12).
        law: contact law.
    """
    for c in range(count):
        i, k = row[c], plate[c]
        t = owner[k]
        p = pose[t]
        qx = position[i, 0] + body[i, 0] - p[9]
        qy = position[i, 1] + body[i, 1] - p[10]
        qz = position[i, 2] + body[i, 2] - p[11]
        x, y, z = turn_back(p, qx, qy, qz)
        a, b, h = plate_coordinates(frame, k, x, y, z)
        ca, cb, inside = closest_in_polygon(corner, corners, k, a, b)
        r = np.float64(max(body[i, 3], _LEAST_AT_PLATE * radius[i]))
        if inside:
            na, nb, nh = 0.0, 0.0, np.float64(side[c])
            overlap = r - h * nh
        else:
            side[c] = np.float32(1.0) if h >= 0.0 else np.float32(-1.0)
            distance = np.sqrt((a - ca) ** 2 + (b - cb) ** 2 + h * h)
            na, nb, nh = (a - ca) / distance, (b - cb) / distance, h / distance
            overlap = r - distance
        # What holds it to the plate fades over a small gap.
        hold = adhesion[i] * min(max(1.0 + overlap / (_BOND_GAP * r), 0.0), 1.0)
        if overlap <= 0.0:
            spring[c, 0] = spring[c, 1] = spring[c, 2] = np.float32(0.0)
            if hold == 0.0:
                continue
        nx = frame[k, 3] * na + frame[k, 6] * nb + frame[k, 9] * nh
        ny = frame[k, 4] * na + frame[k, 7] * nb + frame[k, 10] * nh
        nz = frame[k, 5] * na + frame[k, 8] * nb + frame[k, 11] * nh
        vx, vy, vz = turn_back(
            p,
            body[i, 4] - twist[t, 0] - (twist[t, 4] * qz - twist[t, 5] * qy),
            body[i, 5] - twist[t, 1] - (twist[t, 5] * qx - twist[t, 3] * qz),
            body[i, 6] - twist[t, 2] - (twist[t, 3] * qy - twist[t, 4] * qx),
        )
        # The point that touches is a radius from the centre, and goes round with the spin.
        ax, ay, az = turn_back(
            p, body[i, 12] - twist[t, 3], body[i, 13] - twist[t, 4], body[i, 14] - twist[t, 5]
        )
        push, gx, gy, gz, sx, sy, sz = contact_force(
            law, friction[i], overlap, nx, ny, nz,
            vx - r * (ay * nz - az * ny),
            vy - r * (az * nx - ax * nz),
            vz - r * (ax * ny - ay * nx),
            spring[c, 0], spring[c, 1], spring[c, 2],
        )  # fmt: skip
        spring[c, 0], spring[c, 1], spring[c, 2] = sx, sy, sz
        m = mass[i]
        if overlap <= 0.0:
            push = np.float32(0.0)
            gx, gy, gz = push, push, push
            spring[c, 0] = spring[c, 1] = spring[c, 2] = push
        normal = m * push - np.pi * r * r * hold
        ax, ay, az = normal * nx + m * gx, normal * ny + m * gy, normal * nz + m * gz
        fx = p[0] * ax + p[1] * ay + p[2] * az
        fy = p[3] * ax + p[4] * ay + p[5] * az
        fz = p[6] * ax + p[7] * ay + p[8] * az
        # Where it acts, from the particle's centre.
        ax = -r * (p[0] * nx + p[1] * ny + p[2] * nz)
        ay = -r * (p[3] * nx + p[4] * ny + p[5] * nz)
        az = -r * (p[6] * nx + p[7] * ny + p[8] * nz)
        limit = m * push * rolling[i]
        total[i, 0] += fx
        total[i, 1] += fy
        total[i, 2] += fz
        total[i, 3] += limit
        share = 1.0 / np.float64(body[i, 3])
        total[i, 4] += (ay * fz - az * fy) * share
        total[i, 5] += (az * fx - ax * fz) * share
        total[i, 6] += (ax * fy - ay * fx) * share
        total[i, 12] += limit * twist[t, 3]
        total[i, 13] += limit * twist[t, 4]
        total[i, 14] += limit * twist[t, 5]
        qx, qy, qz = qx + ax, qy + ay, qz + az
        wrench[t, 0] -= fx
        wrench[t, 1] -= fy
        wrench[t, 2] -= fz
        wrench[t, 3] -= qy * fz - qz * fy
        wrench[t, 4] -= qz * fx - qx * fz
        wrench[t, 5] -= qx * fy - qy * fx


@kernel
def _crossings(  # type: ignore[no-untyped-def]
    rows, before, after, radius,
    frame, corner, corners, owner, first_plate, sphere, pose0, pose1,
    contact_plate, contact_side, begin, end, through,
):  # fmt: skip
    """Mark in `through` whose path, seen from the tool, pierces a plate.

    A centre that comes back to the side its contact remembers is not marked again.
    """
    for k_row in range(rows.size):
        i = rows[k_row]
        for t in range(pose0.shape[0]):
            x0, y0, z0 = to_tool(pose0[t], before[k_row, 0], before[k_row, 1], before[k_row, 2])
            x1, y1, z1 = to_tool(pose1[t], after[i, 0], after[i, 1], after[i, 2])
            length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2)
            cx, cy, cz = x1 - sphere[t, 0], y1 - sphere[t, 1], z1 - sphere[t, 2]
            if cx * cx + cy * cy + cz * cz > (sphere[t, 3] + length) ** 2:
                continue
            if length <= _REACH * radius[i]:
                # No plate is within reach but those it has a contact with.
                for m in range(begin[i], end[i]):
                    k = contact_plate[m]
                    if owner[k] == t and _pierces(
                        frame, corner, corners, k, x0, y0, z0, x1, y1, z1, contact_side[m]
                    ):
                        through[k_row] = True
                continue
            for k in range(first_plate[t], first_plate[t + 1]):
                side = np.float32(0.0)
                for m in range(begin[i], end[i]):
                    if contact_plate[m] == k:
                        side = contact_side[m]
                if _pierces(frame, corner, corners, k, x0, y0, z0, x1, y1, z1, side):
                    through[k_row] = True


@kernel
def _pierces(frame, corner, corners, k, x0, y0, z0, x1, y1, z1, side):  # type: ignore[no-untyped-def]
    """Whether a path pierces plate `k` and ends on the other side than `side`, 0 for any."""
    a0, b0, h0 = plate_coordinates(frame, k, x0, y0, z0)
    a1, b1, h1 = plate_coordinates(frame, k, x1, y1, z1)
    if (h0 >= 0.0) == (h1 >= 0.0):
        return False
    share = h0 / (h0 - h1)
    _, _, inside = closest_in_polygon(
        corner, corners, k, a0 + share * (a1 - a0), b0 + share * (b1 - b0)
    )
    if side == 0.0:
        side = np.float32(1.0) if h0 >= 0.0 else np.float32(-1.0)
    return inside and side * h1 < 0.0
