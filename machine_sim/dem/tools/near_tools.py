"""Particles in and near tools: positions in tool frames, and what tools mean for ground contact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.tools.plane import PLANE_NORMAL, PLANE_OFFSET
from machine_sim.dem.tools.pose import (
    ANGULAR,
    LINEAR,
    ORIGIN,
    rotate_to_map_axes,
    to_tool_frame,
)
from machine_sim.dem.tools.tool_set import NO_TOOL, SPHERE_CENTRE, SPHERE_RADIUS
from machine_sim.dem.vec3 import dot, load_row
from msg_bridge.kernels import helper, kernel

__all__ = [
    "ACCELERATION_MARGIN",
    "ROUNDING_MARGIN",
    "SEARCH_RADIUS_FACTOR",
    "NearTools",
    "classify_near_tools",
    "select_near_tools",
]

SEARCH_RADIUS_FACTOR = 1.2
"""Distance from a plate at which a particle without relative motion is listed, in radii."""
ACCELERATION_MARGIN = 1.3
"""Distance ahead that is searched, over the distance travelled in a step at constant velocity."""
ROUNDING_MARGIN = 1e-6
"""Distance that is added so that no particle is missed by a rounding error [m]."""


class NearTools(NamedTuple):
    """Particles that may be near each tool, tool by tool, in ascending order.

    Attributes:
        first: first entry of each tool, and the end, int64, shape (tools + 1,).
        number: which of the rows that were searched each entry is, int64.
        x, y, z: position in the tool's frame [m].
    """

    first: NDArray[np.int64]
    number: NDArray[np.int64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]


@kernel
def select_near_tools(dt, rows, particles, tools, margin):  # type: ignore[no-untyped-def]
    """Select the particles that may touch each tool within a step, or are within a margin of it.

    A particle that is selected may be farther away; one that is not selected is not near. Sites
    have many tools, and most particles are near one of them: each particle is transformed to the
    frames of these alone.

    Args:
        dt: length of the step [s].
        rows: the particles.
        particles: `ParticleColumns`.
        tools: `ToolMotion`.
        margin: distance from the bounding sphere of a tool [m].

    Returns:
        `NearTools`.
    """
    num_tools, pose = tools.twist.shape[0], tools.path[0]
    first, number = np.zeros(num_tools + 1, np.int64), np.empty(num_tools * rows.size, np.int64)
    positions, reach = _load_reach(dt, rows, particles, margin)
    is_near, count = np.empty(rows.size, np.bool_), np.uint64(0)
    for t in range(num_tools):
        _mark_near_tool(dt, pose[t], tools.twist[t], tools.sphere[t], positions, reach, is_near)
        for n in range(rows.size):
            number[count] = n
            count += np.uint64(is_near[n])
        first[t + 1] = count
    x, y, z = np.empty(count), np.empty(count), np.empty(count)
    for t in range(num_tools):
        p = pose[t]
        for k in range(np.uint64(first[t]), np.uint64(first[t + 1])):
            n = np.uint64(number[k])
            x[k], y[k], z[k] = to_tool_frame(p, positions[0, n], positions[1, n], positions[2, n])
    return NearTools(first, number[:count], x, y, z)


@helper(allocates=True, forceinline=True)
def _load_reach(dt, rows, particles, margin):  # type: ignore[no-untyped-def]
    """Return the positions [m], shape (3, rows), and the reach of each particle on its own [m]."""
    position, velocity, radius = particles.position, particles.velocity, particles.radius
    positions, reach = np.empty((3, rows.size)), np.empty(rows.size)
    for n in range(rows.size):
        i = np.uint64(rows[n])
        for axis in range(3):
            positions[axis, n] = position[i, axis]
        v = load_row(velocity, i, 0)
        travel = ACCELERATION_MARGIN * dt * np.sqrt(dot(v, v))
        reach[n] = max(margin, SEARCH_RADIUS_FACTOR * radius[i] + travel)
    return positions, reach


@helper(forceinline=True)
def _mark_near_tool(dt, pose, twist, sphere, positions, reach, is_near):  # type: ignore[no-untyped-def]
    """Mark the particles that may be within their reach of a tool's bounding sphere.

    At a distance d from the centre of the sphere, which is at an arm a from the frame's origin, the
    tool moves at no more than v + w (d + a).
    """
    cx, cy, cz = rotate_to_map_axes(
        pose, sphere[SPHERE_CENTRE], sphere[SPHERE_CENTRE + 1], sphere[SPHERE_CENTRE + 2]
    )
    v = twist[LINEAR], twist[LINEAR + 1], twist[LINEAR + 2]
    w = twist[ANGULAR], twist[ANGULAR + 1], twist[ANGULAR + 2]
    ahead = ACCELERATION_MARGIN * dt
    turn = ahead * np.sqrt(dot(w, w))
    travel = ahead * np.sqrt(dot(v, v)) + turn * np.sqrt(cx * cx + cy * cy + cz * cz)
    own = sphere[SPHERE_RADIUS] + travel + ROUNDING_MARGIN
    scale = 1.0 / (1.0 - turn) if turn < 0.5 else np.inf
    cx, cy, cz = cx + pose[ORIGIN], cy + pose[ORIGIN + 1], cz + pose[ORIGIN + 2]
    for n in range(np.uint64(reach.size)):
        dx, dy, dz = positions[0, n] - cx, positions[1, n] - cy, positions[2, n] - cz
        max_distance = scale * (own + reach[n])
        is_near[n] = dx * dx + dy * dy + dz * dz <= max_distance * max_distance


@helper(allocates=True)
def classify_near_tools(near_tools, tools, margin, inside):  # type: ignore[no-untyped-def]
    """Find the tool that each of some particles is in, and what it means for ground contact.

    The plates of a digging tool keep the terrain away from what is in the tool: a bucket half in
    the ground is below the surface of the columns it stands in. A box that stands on or over the
    ground does not.

    Args:
        near_tools: `NearTools`.
        tools: `ToolMotion`.
        margin: distance from the bounding sphere of a digging tool that counts as near [m].
        inside: out, index of the tool in whose hull each particle that was searched is, `NO_TOOL`
            for none.

    Returns:
        (ground_masked, near), shape (rows,) each: whether that tool digs, and index of a tool that
        digs and that the particle is near, `NO_TOOL` for none.
    """
    hull, first_plane, is_digging = tools.hull, tools.first_plane, tools.is_digging
    inside[:] = NO_TOOL
    ground_masked, near = np.zeros(inside.size, np.bool_), np.full(inside.size, NO_TOOL)
    all_within = np.empty(near_tools.number.size, np.bool_)
    for t in range(first_plane.size - 1):
        low, high = near_tools.first[t], near_tools.first[t + 1]
        x, y, z = near_tools.x[low:high], near_tools.y[low:high], near_tools.z[low:high]
        number, within = near_tools.number[low:high], all_within[low:high]
        if _mark_within_sphere(x, y, z, tools.sphere[t], margin, within) == 0:
            continue
        if is_digging[t]:
            for k in range(number.size):
                if within[k]:
                    near[np.uint64(number[k])] = t
        if first_plane[t + 1] == first_plane[t]:
            continue
        # Plane by plane, so that the loops over particles are vectorised.
        for h in range(first_plane[t], first_plane[t + 1]):
            _exclude_beyond_plane(
                x, y, z,
                hull[h, PLANE_NORMAL],
                hull[h, PLANE_NORMAL + 1],
                hull[h, PLANE_NORMAL + 2],
                hull[h, PLANE_OFFSET],
                within,
            )  # fmt: skip
        for k in range(number.size):
            n = np.uint64(number[k])
            if within[k] and inside[n] == NO_TOOL:
                inside[n], ground_masked[n] = t, is_digging[t]
    return ground_masked, near


@helper(forceinline=True)
def _mark_within_sphere(x, y, z, sphere, margin, within):  # type: ignore[no-untyped-def]
    """Mark the positions within a margin [m] of a bounding sphere, and return their number."""
    count, max_distance2 = 0, (sphere[SPHERE_RADIUS] + margin) ** 2
    for k in range(np.uint64(within.size)):
        dx, dy = x[k] - sphere[SPHERE_CENTRE], y[k] - sphere[SPHERE_CENTRE + 1]
        dz = z[k] - sphere[SPHERE_CENTRE + 2]
        within[k] = dx * dx + dy * dy + dz * dz <= max_distance2
        count += within[k]
    return count


@helper(forceinline=True)
def _exclude_beyond_plane(x, y, z, nx, ny, nz, offset, within):  # type: ignore[no-untyped-def]
    """Clear the mark of each position beyond a plane."""
    for k in range(np.uint64(within.size)):
        within[k] &= nx * x[k] + ny * y[k] + nz * z[k] < offset
