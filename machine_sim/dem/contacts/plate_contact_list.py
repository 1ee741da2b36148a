"""The list of plates that each particle may touch within a step, with the contacts' history.

The list is made in every step. A contact stores its tangential spring and the side of the plate
that the particle is on; both are carried over from the list of the step before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.tools.near_tools import (
    ACCELERATION_MARGIN,
    ROUNDING_MARGIN,
    SEARCH_RADIUS_FACTOR,
)
from machine_sim.dem.tools.plates import (
    BOUNDS_CENTRE,
    BOUNDS_NORMAL,
    BOUNDS_OFFSET,
    BOUNDS_RADIUS,
    closest_in_polygon,
    plate_coordinates,
)
from machine_sim.dem.tools.pose import ANGULAR, LINEAR, ORIGIN
from machine_sim.dem.tools.tool_set import SPHERE_CENTRE, SPHERE_RADIUS
from machine_sim.dem.vec3 import cross, dot, load_row, subtract
from msg_bridge.kernels import BoxedTable, box_table, helper, kernel

__all__ = [
    "PlateCandidates",
    "PlateContactList",
    "PlateContactTable",
    "list_plate_contacts",
]


_NO_PLATES = np.uint64(0)
_NUM_BITS = 64
"""Bits in a set of plates: bit k is that of plate k of a tool; of more plates, several share it."""


class PlateCandidates(NamedTuple):
    """Particles and plates that may touch within a step, in order of rows, then plates.

    Attributes:
        row, plate: row of the particle and number of the plate, int64, shape (n,).
    """

    row: NDArray[np.int64]
    plate: NDArray[np.int64]


class PlateContactArrays(NamedTuple):
    """Arrays of a `PlateContactTable` for kernels; see there.

    Attributes:
        row, plate, spring, side: of each contact.
        begin, end: range of the contacts of each row, int64, shape (rows,).
    """

    row: NDArray[np.int64]
    plate: NDArray[np.int64]
    spring: NDArray[np.float32]
    side: NDArray[np.float32]
    begin: NDArray[np.int64]
    end: NDArray[np.int64]


class PlateContactTable:
    """Particle-plate contacts in order of rows, then plates.

    Attributes:
        row, plate: row of the particle and number of the plate, int64, shape (capacity,).
        spring: elongation of the tangential spring, plate axes [m], float32, shape (capacity, 3).
        side: side of the plate that the particle is on, +1 for that of the normal, else -1,
            float32, shape (capacity,).
        arrays, boxed_arrays: these four, and the range of the contacts of each row, for kernels.
        count: number of contacts.
    """

    def __init__(self, capacity: int) -> None:
        self.row = np.zeros(capacity, np.int64)
        self.plate = np.zeros(capacity, np.int64)
        self.spring = np.zeros((capacity, 3), np.float32)
        self.side = np.zeros(capacity, np.float32)
        self.count = 0
        self._set_num_rows(0)

    def reserve_rows(self, count: int) -> None:
        """Make room for the ranges of a number of rows."""
        if len(self.arrays.begin) < count:
            self._set_num_rows(2 * count)

    def _set_num_rows(self, count: int) -> None:
        self.arrays = PlateContactArrays(
            self.row, self.plate, self.spring, self.side,
            np.zeros(count, np.int64), np.zeros(count, np.int64),
        )  # fmt: skip
        self.boxed_arrays: BoxedTable = box_table(self.arrays)


class PlateContactList:
    """The table of plate contacts, listed in each step with its history carried over.

    Attributes:
        table: contacts of the last step.
        next: table for those of the next step.
    """

    def __init__(self) -> None:
        self.table = PlateContactTable(1024)
        self.next = PlateContactTable(1024)

    def next_table(self, num_rows: int) -> PlateContactTable:
        """Return the table for the contacts of the next step, for a number of particles."""
        self.next.reserve_rows(num_rows)
        return self.next

    def enlarge(self) -> None:
        """Make the next table larger, as it was too small."""
        self.next = PlateContactTable(2 * len(self.next.row))

    def accept(self, count: int, *, has_tools: bool) -> None:
        """Make the next table the present one.

        Args:
            count: number of contacts in it.
            has_tools: whether there are tools; without any the table was not filled.
        """
        if not has_tools:
            self.table.count = 0
            return
        self.next.count = count
        self.table, self.next = self.next, self.table

    def remove(self, low: int, high: int) -> None:
        """Remove plates number `low` to `high` - 1; the numbers of later plates decrease."""
        plate = self.table.plate[: self.table.count]
        is_removed = (plate >= low) & (plate < high)
        plate[plate >= high] -= high - low
        plate[is_removed] = -1


@kernel
def list_plate_contacts(dt, rows, near_tools, particles, tools, old, new):  # type: ignore[no-untyped-def]
    """List all plates that one of `rows` may touch within a step, in the new table.

    Args:
        dt: length of the step [s].
        rows: particles moved by forces.
        near_tools: which of these are near each tool, `NearTools`.
        particles: `ParticleColumns`; the row of each particle in the old table is replaced by that
            in the new one, -1 for none.
        tools: `ToolMotion`.
        old, new: `PlateContactArrays`.

    Returns:
        Number of contacts, or -1 where the new table is too small; nothing else was changed then.
    """
    position, velocity, radius = particles.position, particles.velocity, particles.radius
    list_row = particles.plate_list_row
    plates, first_plate, num_tools = tools.plates, tools.first_plate, tools.twist.shape[0]
    num_near, number = near_tools.number.size, near_tools.number
    reach, close_plates = np.empty(num_near), np.full(num_near, _NO_PLATES)
    is_close_to_any = np.zeros(rows.size, np.bool_)
    for t in range(num_tools):
        low, high = near_tools.first[t], near_tools.first[t + 1]
        _search_radii(
            dt, rows, number[low:high], position, velocity, radius, tools.path[0, t],
            tools.twist[t], reach[low:high],
        )  # fmt: skip
        _mark_close_to_plates(
            near_tools.x[low:high], near_tools.y[low:high], near_tools.z[low:high],
            tools.sphere[t], plates.bounds, first_plate[t], first_plate[t + 1], reach[low:high],
            close_plates[low:high],
        )  # fmt: skip
        for k in range(np.uint64(low), np.uint64(high)):
            is_close_to_any[np.uint64(number[k])] |= close_plates[k] != _NO_PLATES
    row, plate, side, spring = new.row, new.plate, new.side, new.spring
    begin, end, old_begin, old_end = new.begin, new.end, old.begin, old.end
    old_plate, old_side, old_spring = old.plate, old.side, old.spring
    count, entry = 0, near_tools.first[:-1].copy()
    for n in range(rows.size):
        i = np.uint64(rows[n])
        begin[i] = count
        for t in range(num_tools if is_close_to_any[n] else 0):
            e = entry[t] = _find_entry(n, number, entry[t], near_tools.first[t + 1])
            if e == near_tools.first[t + 1] or number[e] != n or close_plates[e] == _NO_PLATES:
                continue
            x, y, z, max_distance = near_tools.x[e], near_tools.y[e], near_tools.z[e], reach[e]
            for k in range(first_plate[t], first_plate[t + 1]):
                if close_plates[e] & _bit_of(k - first_plate[t]) == _NO_PLATES:
                    continue
                a, b, h = plate_coordinates(plates, k, x, y, z)
                if abs(h) > max_distance:
                    continue
                ca, cb, _ = closest_in_polygon(plates, k, a, b)
                if (a - ca) ** 2 + (b - cb) ** 2 + h * h > max_distance * max_distance:
                    continue
                if count == row.size:
                    return -1
                row[count], plate[count] = i, k
                side[count] = np.float32(1.0) if h >= 0.0 else np.float32(-1.0)
                for axis in range(3):
                    spring[count, axis] = np.float32(0.0)
                old_row = list_row[i]
                if old_row >= 0:
                    # Copy side and spring from the former contact of the same two.
                    for m in range(old_begin[old_row], old_end[old_row]):
                        if old_plate[m] == k:
                            side[count] = old_side[m]
                            for axis in range(3):
                                spring[count, axis] = old_spring[m, axis]
                count += 1
        end[i] = count
    list_row[:] = -1
    for i in rows:
        list_row[i] = i
    return count


@helper(forceinline=True)
def _bit_of(k):  # type: ignore[no-untyped-def]
    """Return the bit of plate `k` of a tool in a set of plates."""
    return np.uint64(1) << np.uint64(k % _NUM_BITS)


@helper(forceinline=True)
def _find_entry(n, number, low, high):  # type: ignore[no-untyped-def]
    """Return the first entry from `low` on whose number is `n` or higher, `high` for none."""
    while low < high and number[low] < n:
        low += 1
    return low


@helper(forceinline=True)
def _search_radii(dt, rows, number, position, velocity, radius, pose, twist, reach):  # type: ignore[no-untyped-def]
    """Compute the distance from a tool's plates within which each particle is listed [m].

    It is the radius with a margin plus the distance travelled in the step relative to the tool.

    Args:
        dt: length of the step [s].
        rows, number: rows of particles, and which of them are near the tool.
        position, velocity, radius: columns of `ParticleState`.
        pose, twist: packed pose and twist of the tool.
        reach: out, of those near the tool.
    """
    origin = pose[ORIGIN], pose[ORIGIN + 1], pose[ORIGIN + 2]
    linear = twist[LINEAR], twist[LINEAR + 1], twist[LINEAR + 2]
    angular = twist[ANGULAR], twist[ANGULAR + 1], twist[ANGULAR + 2]
    for n in range(number.size):
        i = np.uint64(rows[np.uint64(number[n])])
        arm = subtract(load_row(position, i, 0), origin)
        relative = subtract(subtract(load_row(velocity, i, 0), linear), cross(angular, arm))
        reach[n] = SEARCH_RADIUS_FACTOR * radius[i] + ACCELERATION_MARGIN * dt * np.sqrt(
            dot(relative, relative)
        )


@helper(forceinline=True)
def _mark_close_to_plates(x, y, z, sphere, bounds, low, high, reach, close_plates):  # type: ignore[no-untyped-def]
    """Find the plates of a tool whose bounds are within reach of each particle.

    The loops are over particles, so that they are vectorised.

    Args:
        x, y, z: centres [m], tool frame.
        sphere: bounding sphere of the tool, see `ToolSet`.
        bounds: bounds of the plates, see `Plates`.
        low, high: first plate of the tool and the end, which is excluded.
        reach: see `_search_radii`.
        close_plates: updated, set of plates of each centre, uint64.
    """
    num_in_sphere = 0
    for n in range(np.uint64(reach.size)):
        dx, dy = x[n] - sphere[SPHERE_CENTRE], y[n] - sphere[SPHERE_CENTRE + 1]
        dz = z[n] - sphere[SPHERE_CENTRE + 2]
        max_distance = sphere[SPHERE_RADIUS] + reach[n]
        num_in_sphere += dx * dx + dy * dy + dz * dz <= max_distance * max_distance
    if num_in_sphere == 0:
        return
    for k in range(low, high):
        nx, ny, nz = (
            bounds[BOUNDS_NORMAL, k],
            bounds[BOUNDS_NORMAL + 1, k],
            bounds[BOUNDS_NORMAL + 2, k],
        )
        cx, cy, cz = (
            bounds[BOUNDS_CENTRE, k],
            bounds[BOUNDS_CENTRE + 1, k],
            bounds[BOUNDS_CENTRE + 2, k],
        )
        height, bounds_radius = bounds[BOUNDS_OFFSET, k], bounds[BOUNDS_RADIUS, k]
        bit = _bit_of(k - low)
        for n in range(np.uint64(reach.size)):
            above = abs(nx * x[n] + ny * y[n] + nz * z[n] - height)
            dx, dy, dz = x[n] - cx, y[n] - cy, z[n] - cz
            own_reach = reach[n] + ROUNDING_MARGIN
            max_distance = bounds_radius + own_reach
            in_sphere = dx * dx + dy * dy + dz * dz <= max_distance * max_distance
            close_plates[n] |= bit if (above <= own_reach) & in_sphere else _NO_PLATES
