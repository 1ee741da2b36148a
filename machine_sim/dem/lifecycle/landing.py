"""Which particles are done being particles: at rest on the ground, or off the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.params import ParticleParams
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.ground.contact_surface import Ground
from msg_bridge.kernels import kernel

__all__ = ["distance_to_plates", "settled_rows"]


def settled_rows(
    state: ParticleState, ground: Ground, tools: list[RigidTool], params: ParticleParams
) -> NDArray[np.intp]:
    """Rows that should land, in order of particle id.

    A particle lands when it has been slow on the ground for `settle_time`, free of every tool:
    farther than `tool_clearance` from its plates and outside its convex hull. One off the map
    always does. A frozen one has landed already.
    """
    width, breadth = ground.grid.size
    rows: NDArray[np.intp] = _landing_candidates(
        state.position, state.settle_timer, state.frozen, 0.5 * width, 0.5 * breadth,
        np.float32(params.settle_time),
    )  # fmt: skip
    if rows.size == 0:  # nearly always
        return rows
    free = np.ones(rows.size, dtype=np.bool_)
    for tool in tools:
        plates = tool.plates
        _exclude_near_tool(
            rows, state.position, state.radius, *tool.end, tool.centre, tool.bounding_radius, tool.hull,
            plates, params.tool_clearance, free,
        )  # fmt: skip
    outside = ~ground.grid.contains(state.position[rows, 0], state.position[rows, 1])
    rows = rows[free | outside]
    return np.asarray(rows[np.argsort(state.particle_id[rows])], dtype=np.intp)


@kernel
def _landing_candidates(position, settle_timer, frozen, half_x, half_y, settle_time):  # type: ignore[no-untyped-def]
    """Rows of those that have been slow for `settle_time`, or are off the map; none is frozen."""
    rows = np.empty(len(frozen), dtype=np.intp)
    count = 0
    for i in range(len(frozen)):
        inside = abs(position[i, 0]) <= half_x and abs(position[i, 1]) <= half_y
        if (settle_timer[i] >= settle_time or not inside) and not frozen[i]:
            rows[count] = i
            count += 1
    return rows[:count].copy()


@kernel
def _exclude_near_tool(  # type: ignore[no-untyped-def]
    rows, position, radius, rotation, origin, centre, bounding_radius, hull, plates,
    clearance, free,
):  # fmt: skip
    """Strike those out of `free` that a tool holds or has within `clearance`."""
    for k in range(rows.size):
        i = rows[k]
        p = position[i]
        qx, qy, qz = p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]
        x = qx * rotation[0, 0] + qy * rotation[1, 0] + qz * rotation[2, 0]
        y = qx * rotation[0, 1] + qy * rotation[1, 1] + qz * rotation[2, 1]
        z = qx * rotation[0, 2] + qy * rotation[1, 2] + qz * rotation[2, 2]
        far = bounding_radius + clearance + radius[i]
        if (x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2 > far * far:
            continue
        inside_hull = len(hull) > 0
        for h in range(len(hull)):
            inside_hull &= hull[h, 0] * x + hull[h, 1] * y + hull[h, 2] * z < hull[h, 3]
        free[k] &= not inside_hull and distance_to_plates(plates, x, y, z) - radius[i] > clearance


@kernel
def distance_to_plates(plates, x, y, z):  # type: ignore[no-untyped-def]
    """Distance of a point of the tool frame to the nearest plate."""
    nearest = 1e300
    for k in range(plates.num_corners.size):
        a, b, h = plate_coordinates(plates, k, x, y, z)
        ca, cb, _ = closest_in_polygon(plates, k, a, b)
        nearest = min(nearest, (a - ca) ** 2 + (b - cb) ** 2 + h * h)
    return np.sqrt(nearest)
