"""Which plates each particle may touch within a step, listed anew with what contacts remember."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.tool_set import ToolSet
from msg_bridge.kernels import kernel

__all__ = ["SEARCH_RADIUS_FACTOR", "PlateCandidates", "PlateContactList", "PlateContactTable"]

SEARCH_RADIUS_FACTOR = 1.2
"""How far plates are listed from a particle that does not move, in radii."""


class PlateCandidates(NamedTuple):
    """Who may touch which plate within a step, in order of rows, then plates.

    Attributes:
        row, plate: of each contact, int64, shape (n,).
    """

    row: NDArray[np.int64]
    plate: NDArray[np.int64]


class PlateContactTable:
    """Particle-plate contacts in order of rows, then plates.

    Attributes:
        row, plate: of each contact, int64.
        spring: tangential spring [m], plate axes, shape (room, 3).
        side: +1 or -1, the side of the plate's normal.
        begin, end: contacts of each row, shape (n,).
        count: number of contacts.
    """

    def __init__(self, capacity: int, rows: int) -> None:
        self.row = np.zeros(capacity, np.int64)
        self.plate = np.zeros(capacity, np.int64)
        self.spring = np.zeros((capacity, 3), np.float32)
        self.side = np.zeros(capacity, np.float32)
        self.begin = np.zeros(rows, np.int64)
        self.end = np.zeros(rows, np.int64)
        self.count = 0

    @property
    def candidates(self) -> PlateCandidates:
        """Its contacts."""
        return PlateCandidates(self.row[: self.count], self.plate[: self.count])


class PlateContactList:
    """The contact table, listed anew each step with its history carried over."""

    def __init__(self) -> None:
        self.table = PlateContactTable(1024, 0)
        self._spare = PlateContactTable(1024, 0)

    def update(  # type: ignore[no-untyped-def]
        self, state: ParticleState, rows, tools: ToolSet, tool_frame_positions, dt: float
    ) -> None:
        """List all plates that one of `rows` may touch within the next `dt` [s].

        Args:
            store: the particles.
            rows: of those that move.
            tools: which have begun the step.
            places: of these, see `ToolSet.places`.
            dt: [s].
        """
        old = self.table
        if not tools.tools:
            old.count = 0
            return
        while True:
            new = self._spare
            if len(new.begin) < state.count:
                new.begin = np.zeros(2 * state.count, np.int64)
                new.end = np.zeros(2 * state.count, np.int64)
            new.count = _list_candidates(
                dt, rows, tool_frame_positions, state.position, state.velocity, state.radius, state.plate_list_row,
                tools.plates, tools.first_plate,
                tools.sphere, tools.path[0], tools.twist,
                old.plate, old.spring, old.side, old.begin, old.end,
                new.row, new.plate, new.spring, new.side, new.begin, new.end,
            )  # fmt: skip
            if new.count >= 0:
                break
            self._spare = PlateContactTable(2 * len(new.row), 0)
        self.table, self._spare = new, old

    def remove(self, low: int, high: int) -> None:
        """Forget plates number `low` to below `high`; those behind move up."""
        plate = self.table.plate[: self.table.count]
        gone = (plate >= low) & (plate < high)
        plate[plate >= high] -= high - low
        plate[gone] = -1


@kernel
def _list_candidates(  # type: ignore[no-untyped-def]
    dt, rows, tool_frame_positions, position, velocity, radius, old_row,
    plates, first_plate, sphere, pose, twist,
    old_plate, old_spring, old_side, old_begin, old_end,
    row, plate, spring, side, begin, end,
):  # fmt: skip
    """Fill the table; returns the number of contacts, -1 where it is too small.

    Args:
        old_row: in and out, row of each particle in the old table, then in the new; -1 for none.
        The rest: see `PlateContactList.refresh`, `ToolSet` and `PlateContactTable`, the old and the new.
    """
    tools = pose.shape[0]
    reach, close = np.empty((tools, rows.size)), np.zeros((tools, rows.size), np.bool_)
    for t in range(tools):
        _search_radii(dt, rows, position, velocity, radius, pose[t], twist[t], reach[t])
        low, high = first_plate[t], first_plate[t + 1]
        _mark_close_to_plates(
            tool_frame_positions[t], sphere[t], plates.bounds, low, high, reach[t], close[t]
        )
    count = 0
    for n in range(rows.size):
        i = rows[n]
        begin[i] = count
        for t in range(tools):
            if not close[t, n]:
                continue
            x, y, z, far = (
                tool_frame_positions[t, 0, n],
                tool_frame_positions[t, 1, n],
                tool_frame_positions[t, 2, n],
                reach[t, n],
            )
            for k in range(first_plate[t], first_plate[t + 1]):
                a, b, h = plate_coordinates(plates, k, x, y, z)
                if abs(h) > far:
                    continue
                ca, cb, _ = closest_in_polygon(plates, k, a, b)
                if (a - ca) ** 2 + (b - cb) ** 2 + h * h > far * far:
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
    old_row[:] = -1
    for i in rows:
        old_row[i] = i
    return count


@kernel
def _search_radii(dt, rows, position, velocity, radius, pose, twist, reach):  # type: ignore[no-untyped-def]
    """How far each may come to be from where it is, seen from a tool, its size included [m]."""
    for n in range(rows.size):
        i = rows[n]
        x, y, z = position[i, 0] - pose[9], position[i, 1] - pose[10], position[i, 2] - pose[11]
        vx = velocity[i, 0] - twist[0] - (twist[4] * z - twist[5] * y)
        vy = velocity[i, 1] - twist[1] - (twist[5] * x - twist[3] * z)
        vz = velocity[i, 2] - twist[2] - (twist[3] * y - twist[4] * x)
        reach[n] = SEARCH_RADIUS_FACTOR * radius[i] + 1.3 * dt * np.sqrt(
            vx * vx + vy * vy + vz * vz
        )


@kernel
def _mark_close_to_plates(tool_frame_positions, sphere, bounds, low, high, reach, close):  # type: ignore[no-untyped-def]
    """Mark who may be within reach of one of the plates from `low` to `high`, many at a time."""
    around = 0
    for n in range(np.uint64(reach.size)):
        x, y, z = (
            tool_frame_positions[0, n] - sphere[0],
            tool_frame_positions[1, n] - sphere[1],
            tool_frame_positions[2, n] - sphere[2],
        )
        far = sphere[3] + reach[n]
        around += x * x + y * y + z * z <= far * far
    if around == 0:
        return
    for k in range(low, high):
        nx, ny, nz, height = bounds[0, k], bounds[1, k], bounds[2, k], bounds[3, k]
        cx, cy, cz, size = bounds[4, k], bounds[5, k], bounds[6, k], bounds[7, k]
        for n in range(np.uint64(reach.size)):
            x, y, z = (
                tool_frame_positions[0, n],
                tool_frame_positions[1, n],
                tool_frame_positions[2, n],
            )
            above = abs(nx * x + ny * y + nz * z - height)
            x -= cx
            y -= cy
            z -= cz
            far = size + reach[n]
            close[n] |= (above <= reach[n]) & (x * x + y * y + z * z <= far * far)
