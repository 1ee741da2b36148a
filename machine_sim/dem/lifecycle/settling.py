"""Settled particles, at rest on the ground or off the map, which can be deposited as terrain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.params import ParticleParams
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.plane import PLANE_NORMAL, PLANE_OFFSET
from machine_sim.dem.tools.plates import Plates, closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.ground.contact_surface import Ground
from msg_bridge.kernels import kernel

__all__ = ["distance_to_plates", "settled_rows"]


class _PlacedTool(NamedTuple):
    """A tool at its end pose, for the kernel: rotation and origin of the pose, and its shape."""

    rotation: NDArray[np.float64]
    origin: NDArray[np.float64]
    centre: NDArray[np.float64]
    bounding_radius: float
    hull: NDArray[np.float64]
    plates: Plates


def settled_rows(
    state: ParticleState, ground: Ground, tools: list[RigidTool], params: ParticleParams
) -> NDArray[np.intp]:
    """Return the rows of settled particles, in order of particle id.

    A particle is settled when it has been slow on the ground for `settle_time` and is free of every
    tool: outside its convex hull, and farther than `tool_clearance` from its plates. A particle off
    the map is settled at once. Frozen particles are excluded: their deposit is requested already.
    """
    size_x, size_y = ground.grid.size
    rows: NDArray[np.intp] = _settled_candidates(
        state.position, state.settle_timer, state.frozen, 0.5 * size_x, 0.5 * size_y,
        np.float32(params.settle_time),
    )  # fmt: skip
    if rows.size == 0:  # the usual case
        return rows
    is_free = np.ones(rows.size, dtype=np.bool_)
    for tool in tools:
        placed = _PlacedTool(*tool.end, tool.centre, tool.bounding_radius, tool.hull, tool.plates)
        _exclude_near_tool(
            rows, state.position, state.radius, placed, params.tool_clearance, is_free
        )
    is_off_map = ~ground.grid.contains(state.position[rows, 0], state.position[rows, 1])
    rows = rows[is_free | is_off_map]
    return np.asarray(rows[np.argsort(state.particle_id[rows])], dtype=np.intp)


@kernel
def _settled_candidates(position, settle_timer, frozen, half_x, half_y, settle_time):  # type: ignore[no-untyped-def]
    """Return the rows, not frozen, that were slow for `settle_time` [s] or are off the map."""
    rows = np.empty(len(frozen), dtype=np.intp)
    count = 0
    for i in range(len(frozen)):
        is_on_map = abs(position[i, 0]) <= half_x and abs(position[i, 1]) <= half_y
        if (settle_timer[i] >= settle_time or not is_on_map) and not frozen[i]:
            rows[count] = i
            count += 1
    return rows[:count].copy()


@kernel
def _exclude_near_tool(rows, position, radius, tool, clearance, is_free):  # type: ignore[no-untyped-def]
    """Clear the marks of the particles in the hull of a `_PlacedTool` or near its plates."""
    rotation, origin, centre, hull = tool.rotation, tool.origin, tool.centre, tool.hull
    for k in range(rows.size):
        i = rows[k]
        p = position[i]
        qx, qy, qz = p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]
        x = qx * rotation[0, 0] + qy * rotation[1, 0] + qz * rotation[2, 0]
        y = qx * rotation[0, 1] + qy * rotation[1, 1] + qz * rotation[2, 1]
        z = qx * rotation[0, 2] + qy * rotation[1, 2] + qz * rotation[2, 2]
        reach = tool.bounding_radius + clearance + radius[i]
        if (x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2 > reach * reach:
            continue
        in_hull = len(hull) > 0
        for h in range(len(hull)):
            height = hull[h, PLANE_NORMAL] * x + hull[h, PLANE_NORMAL + 1] * y
            in_hull &= height + hull[h, PLANE_NORMAL + 2] * z < hull[h, PLANE_OFFSET]
        is_free[k] &= (
            not in_hull and distance_to_plates(tool.plates, x, y, z) - radius[i] > clearance
        )


@kernel
def distance_to_plates(plates, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance [m] of a point of the tool frame to the nearest plate."""
    min_distance2 = 1e300
    for k in range(plates.num_corners.size):
        a, b, h = plate_coordinates(plates, k, x, y, z)
        ca, cb, _ = closest_in_polygon(plates, k, a, b)
        min_distance2 = min(min_distance2, (a - ca) ** 2 + (b - cb) ** 2 + h * h)
    return np.sqrt(min_distance2)
