"""Count of particles that passed through a plate within a step, which must never happen."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.tools.near_tools import SEARCH_RADIUS_FACTOR
from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import ORIGIN, XX, to_tool_frame
from machine_sim.dem.tools.tool_set import SPHERE_CENTRE, SPHERE_RADIUS
from machine_sim.dem.vec3 import dot, load_row, subtract
from msg_bridge.kernels import helper, kernel

__all__ = ["count_tunnelled"]


@kernel
def count_tunnelled(rows, before, particles, tools, contacts):  # type: ignore[no-untyped-def]
    """Count the particles whose path in the frame of a tool pierces one of its plates.

    A centre that returns to the side that its contact stores is not counted again.

    Args:
        rows: rows of the particles moved by forces.
        before: their centres at the start of the step [m], map frame, shape (rows, 3).
        particles: `ParticleColumns` at the end of the step.
        tools: `ToolMotion`.
        contacts: `PlateContactArrays`.
    """
    after, radius, sphere, path = particles.position, particles.radius, tools.sphere, tools.path
    plates, tool_of_plate, first_plate = tools.plates, tools.tool_of_plate, tools.first_plate
    start, end = path[0], path[path.shape[0] - 1]
    contact_begin, contact_end = contacts.begin, contacts.end
    contact_plate, contact_side = contacts.plate, contacts.side
    tool_displacement = np.empty(start.shape[0])
    for t in range(start.shape[0]):
        tool_displacement[t] = _max_tool_displacement(start[t], end[t], sphere[t])
    count = 0
    for n in range(rows.size):
        i = np.uint64(rows[n])
        displacement = subtract(load_row(after, i, 0), load_row(before, n, 0))
        own_displacement = np.sqrt(dot(displacement, displacement))
        tunnelled = False
        for t in range(start.shape[0]):
            # Plates within this distance of the particle are in the contact table.
            listed_distance = SEARCH_RADIUS_FACTOR * radius[i]
            first, last = contact_begin[i], contact_end[i]
            if first == last and own_displacement + tool_displacement[t] <= listed_distance:
                # No plate was within that distance, and none has come nearer by more than it: a
                # tool turns by less than a right angle in a step.
                continue
            x0, y0, z0 = to_tool_frame(start[t], before[n, 0], before[n, 1], before[n, 2])
            x1, y1, z1 = to_tool_frame(end[t], after[i, 0], after[i, 1], after[i, 2])
            segment = (x0, y0, z0), (x1, y1, z1)
            length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2)
            sx, sy, sz = load_row(sphere, t, SPHERE_CENTRE)
            cx, cy, cz = x1 - sx, y1 - sy, z1 - sz
            if cx * cx + cy * cy + cz * cz > (sphere[t, SPHERE_RADIUS] + length) ** 2:
                continue
            if length <= listed_distance:
                # No plate is within that distance but those that it has a contact with.
                for m in range(first, last):
                    k = contact_plate[m]
                    tunnelled |= tool_of_plate[k] == t and _crosses_plate(
                        plates, k, segment, contact_side[m]
                    )
                continue
            for k in range(first_plate[t], first_plate[t + 1]):
                side = np.float32(0.0)
                for m in range(first, last):
                    if contact_plate[m] == k:
                        side = contact_side[m]
                tunnelled |= _crosses_plate(plates, k, segment, side)
        count += tunnelled
    return count


@helper(forceinline=True)
def _max_tool_displacement(start, end, sphere):  # type: ignore[no-untyped-def]
    """Return an upper bound of the displacement of any point of a tool [m].

    It is the displacement of the centre of the bounding sphere, plus the radius times the Frobenius
    norm of the change of the rotation: no vector changes by more than its length times that norm.

    Args:
        start, end: packed poses.
        sphere: bounding sphere of the tool, see `ToolSet`.
    """
    centre_displacement2, rotation_change2 = 0.0, 0.0
    for c in range(3):
        centre = end[ORIGIN + c] - start[ORIGIN + c]
        for k in range(3):
            change = end[XX + 3 * c + k] - start[XX + 3 * c + k]
            centre += change * sphere[SPHERE_CENTRE + k]
            rotation_change2 += change * change
        centre_displacement2 += centre * centre
    return np.sqrt(centre_displacement2) + np.sqrt(rotation_change2) * sphere[SPHERE_RADIUS]


@helper(forceinline=True)
def _crosses_plate(plates, k, segment, side):  # type: ignore[no-untyped-def]
    """Return whether a segment pierces a plate and ends on the side opposite to `side`.

    Args:
        plates: `Plates` of all tools.
        k: number of the plate.
        segment: first and last point [m], tool frame.
        side: +1 or -1; 0 for the side on which the segment begins.
    """
    (x0, y0, z0), (x1, y1, z1) = segment
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
