"""Particles in and near tools: positions in tool frames, and what tools mean for ground contact."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.tools.plane import PLANE_NORMAL, PLANE_OFFSET
from machine_sim.dem.tools.pose import to_tool_frame
from machine_sim.dem.tools.tool_set import NO_TOOL, SPHERE_CENTRE, SPHERE_RADIUS
from msg_bridge.kernels import helper, kernel

__all__ = ["classify_near_tools", "tool_frame_positions"]


@kernel
def tool_frame_positions(rows, position, pose):  # type: ignore[no-untyped-def]
    """Return the positions of some particles in each tool's frame [m], shape (tools, 3, rows).

    Args:
        rows: the particles.
        position: centres of all particles [m], map frame, shape (n, 3).
        pose: packed poses of the tools, shape (tools, POSE_SIZE).
    """
    positions = np.empty((pose.shape[0], 3, rows.size))
    for t in range(pose.shape[0]):
        p = pose[t]
        for n in range(rows.size):
            i = rows[n]
            x, y, z = to_tool_frame(p, position[i, 0], position[i, 1], position[i, 2])
            positions[t, 0, n] = x
            positions[t, 1, n] = y
            positions[t, 2, n] = z
    return positions


@helper
def classify_near_tools(positions, tools, margin):  # type: ignore[no-untyped-def]
    """Find the tool that each of some particles is in, and what it means for ground contact.

    The plates of a digging tool keep the terrain away from what is in the tool: a bucket half in
    the ground is below the surface of the columns it stands in. A box that stands on or over the
    ground does not.

    Args:
        positions: see `tool_frame_positions`.
        tools: `ToolMotion`.
        margin: distance from the bounding sphere of a digging tool that counts as near [m].

    Returns:
        (inside, ground_masked, near), shape (rows,) each: index of the tool in whose hull the
        particle is, `NO_TOOL` for none; whether that tool digs; and whether the particle is near a
        tool that digs.
    """
    sphere, hull, first_plane = tools.sphere, tools.hull, tools.first_plane
    is_digging, num_rows = tools.is_digging, positions.shape[2]
    inside = np.full(num_rows, NO_TOOL, np.int64)
    ground_masked, near = np.zeros(num_rows, np.bool_), np.zeros(num_rows, np.bool_)
    within = np.empty(num_rows, np.bool_)
    for t in range(sphere.shape[0]):
        num_within = _mark_within_sphere(positions[t], sphere[t], margin, within)
        if num_within == 0:
            continue
        if is_digging[t]:
            near |= within
        if first_plane[t + 1] == first_plane[t]:
            continue
        # Plane by plane, so that the loops over particles are vectorised.
        for h in range(first_plane[t], first_plane[t + 1]):
            _exclude_beyond_plane(
                positions[t],
                hull[h, PLANE_NORMAL],
                hull[h, PLANE_NORMAL + 1],
                hull[h, PLANE_NORMAL + 2],
                hull[h, PLANE_OFFSET],
                within,
            )
        for n in range(num_rows):
            if within[n] and inside[n] == NO_TOOL:
                inside[n], ground_masked[n] = t, is_digging[t]
    return inside, ground_masked, near


@helper(forceinline=True)
def _mark_within_sphere(positions, sphere, margin, within):  # type: ignore[no-untyped-def]
    """Mark the positions within a margin [m] of a bounding sphere, and return their number."""
    count, max_distance2 = 0, (sphere[SPHERE_RADIUS] + margin) ** 2
    for n in range(np.uint64(within.size)):
        x = positions[0, n] - sphere[SPHERE_CENTRE]
        y = positions[1, n] - sphere[SPHERE_CENTRE + 1]
        z = positions[2, n] - sphere[SPHERE_CENTRE + 2]
        within[n] = x * x + y * y + z * z <= max_distance2
        count += within[n]
    return count


@helper(forceinline=True)
def _exclude_beyond_plane(positions, nx, ny, nz, offset, within):  # type: ignore[no-untyped-def]
    """Clear the mark of each position beyond a plane."""
    for n in range(np.uint64(within.size)):
        within[n] &= nx * positions[0, n] + ny * positions[1, n] + nz * positions[2, n] < offset
