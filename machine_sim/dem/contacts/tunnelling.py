"""Who went through a plate within a step: what a simulation must never do, counted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.contacts.plate_contact_list import SEARCH_RADIUS_FACTOR, PlateContactTable
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import to_tool_frame
from machine_sim.dem.tools.tool_set import ToolSet
from msg_bridge.kernels import kernel

__all__ = ["count_tunnelled"]


def count_tunnelled(
    table: PlateContactTable,
    state: ParticleState,
    rows: NDArray[np.int64],
    tools: ToolSet,
    before: NDArray[np.float64],
) -> int:
    """How many of `rows` went through a plate in this step, in the frame of the moving tool.

    Args:
        table: their contacts.
        store: the particles.
        rows: who moved.
        tools: what may have been gone through.
        before: their centres at the start of the step [m], map frame, shape (rows, 3).
    """
    return int(
        _count_tunnelled(
            rows, before, state.position, state.radius,
            tools.plates, tools.tool_of_plate, tools.first_plate, tools.sphere,
            tools.path[0], tools.path[-1], table.plate, table.side, table.begin, table.end,
        )
    )  # fmt: skip


@kernel
def _count_tunnelled(  # type: ignore[no-untyped-def]
    rows, before, after, radius, plates, tool_of_plate, first, sphere, start, last,
    contact_plate, contact_side, begin, end,
):  # fmt: skip
    """How many paths, seen from a tool, pierce a plate.

    A centre that comes back to the side its contact remembers is not counted again.
    """
    max_displacement = np.empty(start.shape[0])
    for t in range(max_displacement.size):
        max_displacement[t] = _max_tool_displacement(start[t], last[t], sphere[t])
    count = 0
    for n in range(rows.size):
        i = rows[n]
        dx, dy, dz = (
            after[i, 0] - before[n, 0],
            after[i, 1] - before[n, 1],
            after[i, 2] - before[n, 2],
        )
        own = np.sqrt(dx * dx + dy * dy + dz * dz)
        through = False
        for t in range(max_displacement.size):
            if begin[i] == end[i] and own + max_displacement[t] <= SEARCH_RADIUS_FACTOR * radius[i]:
                # No plate was within reach, and none has come nearer than that: a tool turns by
                # less than a right angle in a step.
                continue
            x0, y0, z0 = to_tool_frame(start[t], before[n, 0], before[n, 1], before[n, 2])
            x1, y1, z1 = to_tool_frame(last[t], after[i, 0], after[i, 1], after[i, 2])
            length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2)
            cx, cy, cz = x1 - sphere[t, 0], y1 - sphere[t, 1], z1 - sphere[t, 2]
            if cx * cx + cy * cy + cz * cz > (sphere[t, 3] + length) ** 2:
                continue
            if length <= SEARCH_RADIUS_FACTOR * radius[i]:
                # No plate is within reach but those it has a contact with.
                for m in range(begin[i], end[i]):
                    k = contact_plate[m]
                    if tool_of_plate[k] == t and _crosses_plate(
                        plates, k, x0, y0, z0, x1, y1, z1, contact_side[m]
                    ):
                        through = True
                continue
            for k in range(first[t], first[t + 1]):
                side = np.float32(0.0)
                for m in range(begin[i], end[i]):
                    if contact_plate[m] == k:
                        side = contact_side[m]
                if _crosses_plate(plates, k, x0, y0, z0, x1, y1, z1, side):
                    through = True
        count += through
    return count


@kernel
def _max_tool_displacement(start, end, sphere):  # type: ignore[no-untyped-def]
    """How far a point of a tool has come at most [m]: its middle's way, and the turn about it."""
    way, turn = 0.0, 0.0
    for c in range(3):
        middle = end[9 + c] - start[9 + c]
        for k in range(3):
            change = end[3 * c + k] - start[3 * c + k]
            middle += change * sphere[k]
            turn += change * change
        way += middle * middle
    # No vector is changed by more than its length times the Frobenius norm of the change.
    return np.sqrt(way) + np.sqrt(turn) * sphere[3]


@kernel
def _crosses_plate(plates, k, x0, y0, z0, x1, y1, z1, side):  # type: ignore[no-untyped-def]
    """Whether a path pierces plate `k` and ends on the other side than `side`, 0 for any."""
    a0, b0, h0 = plate_coordinates(plates, k, x0, y0, z0)
    a1, b1, h1 = plate_coordinates(plates, k, x1, y1, z1)
    if (h0 >= 0.0) == (h1 >= 0.0):
        return False
    fraction = h0 / (h0 - h1)
    _, _, inside = closest_in_polygon(
        plates, k, a0 + fraction * (a1 - a0), b0 + fraction * (b1 - b0)
    )
    if side == 0.0:
        side = np.float32(1.0) if h0 >= 0.0 else np.float32(-1.0)
    return inside and side * h1 < 0.0
