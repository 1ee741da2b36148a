"""Settled particles, at rest on the ground or off the map, which can be deposited as terrain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.params import ParticleParams
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.plane import PLANE_NORMAL, PLANE_OFFSET
from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import to_tool_frame
from machine_sim.dem.tools.tool_set import SPHERE_CENTRE, SPHERE_RADIUS, ToolSet
from machine_sim.ground.contact_surface import Ground
from msg_bridge.kernels import fixed_signature_kernel, helper, kernel

__all__ = ["distance_to_plates", "freeze_rows", "settled_ids"]


def settled_ids(
    state: ParticleState, ground: Ground, tools: ToolSet, params: ParticleParams
) -> NDArray[np.uint32]:
    """Return the ids of settled particles, ascending.

    A particle is settled when it has been slow on the ground for `settle_time` and is free of every
    tool: outside its convex hull, and farther than `tool_clearance` from its plates. A particle off
    the map is settled at once. Frozen particles are excluded: their deposit is requested already.
    """
    ids = np.empty(state.count, np.uint32)
    count = _list_settled_ids(
        state.boxed, *ground.half_size, params.settle_time, tools.boxed_motion,
        params.tool_clearance, ids,
    )  # fmt: skip
    return ids[:count]


@fixed_signature_kernel
def freeze_rows(rows, boxed_particles):  # type: ignore[no-untyped-def]
    """Fix rows of a `ParticleColumns` whose deposit is requested, at rest where they are."""
    particles = boxed_particles.table
    for i in rows:
        particles.frozen[i] = True
        particles.inverse_mass[i] = np.float32(0.0)
        for axis in range(3):
            particles.velocity[i, axis] = 0.0
            particles.angular_velocity[i, axis] = np.float32(0.0)


@fixed_signature_kernel
def _list_settled_ids(  # type: ignore[no-untyped-def]
    boxed_particles, half_x, half_y, min_time, boxed_tools, clearance, settled
):
    """List the ids of settled particles, ascending, and return their number.

    Args:
        boxed_particles: `ParticleColumns`, boxed.
        half_x, half_y: half the extent of the map [m].
        min_time: time for which a particle must have been slow on the ground [s].
        boxed_tools: `ToolMotion`, boxed.
        clearance: minimum gap to the plates of a tool [m].
        settled: out, ids, with room for all particles.
    """
    particles, tools = boxed_particles.table, boxed_tools.table
    position, frozen, ids = particles.position, particles.frozen, particles.particle_id
    poses, settle_time, count = tools.poses[1], np.float32(min_time), 0
    for i in range(frozen.size):
        is_on_map = abs(position[i, 0]) <= half_x and abs(position[i, 1]) <= half_y
        if frozen[i] or (is_on_map and particles.settle_timer[i] < settle_time):
            continue
        if not is_on_map or _is_free(position[i], particles.radius[i], tools, poses, clearance):
            settled[count] = ids[i]
            count += 1
    settled[:count].sort()
    return count


@helper
def _is_free(position, radius, tools, poses, clearance):  # type: ignore[no-untyped-def]
    """Return whether a particle is outside the hulls of all tools and clear of their plates."""
    sphere, hull = tools.sphere, tools.hull
    for t in range(poses.shape[0]):
        x, y, z = to_tool_frame(poses[t], position[0], position[1], position[2])
        reach = sphere[t, SPHERE_RADIUS] + clearance + radius
        dx, dy = x - sphere[t, SPHERE_CENTRE], y - sphere[t, SPHERE_CENTRE + 1]
        dz = z - sphere[t, SPHERE_CENTRE + 2]
        if dx * dx + dy * dy + dz * dz > reach * reach:
            continue
        low, high = tools.first_plane[t], tools.first_plane[t + 1]
        in_hull = high > low
        for h in range(low, high):
            height = hull[h, PLANE_NORMAL] * x + hull[h, PLANE_NORMAL + 1] * y
            in_hull &= height + hull[h, PLANE_NORMAL + 2] * z < hull[h, PLANE_OFFSET]
        distance = distance_to_plates(
            tools.plates, tools.first_plate[t], tools.first_plate[t + 1], x, y, z
        )
        if in_hull or distance - radius <= clearance:
            return False
    return True


@kernel
def distance_to_plates(plates, low, high, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance [m] of a point of the tool frame to the nearest plate in low..high-1."""
    min_distance2 = 1e300
    for k in range(low, high):
        a, b, h = plate_coordinates(plates, k, x, y, z)
        ca, cb, _ = closest_in_polygon(plates, k, a, b)
        min_distance2 = min(min_distance2, (a - ca) ** 2 + (b - cb) ** 2 + h * h)
    return np.sqrt(min_distance2)
