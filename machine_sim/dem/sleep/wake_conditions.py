"""Conditions that wake sleeping particles: moving contacts, changed ground, approaching tools.

Sleep needs support, and support that moves slowly is as bad as an impact. So a contact wakes by
*displacement*, not by speed: each awake particle has a wake reference, the position where it was
when the particles that sleep against it last had a valid support. Once it is farther from there
than a small part of its radius, every particle that it touched there or touches now wakes too. The
waking spreads as these begin to move.
"""

from __future__ import annotations

import numpy as np

from machine_sim.dem.sleep.sleep_state import (
    ASLEEP_ON_MAP,
    AWAKE,
    locked_state,
    locked_tool,
    wake,
)
from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import ORIGIN, to_tool_frame, velocity_at
from machine_sim.dem.tools.tool_set import SPHERE_CENTRE, SPHERE_RADIUS
from msg_bridge.kernels import helper

__all__ = [
    "WAKE_SPHERE_SIZE",
    "load_approaches_soil",
    "wake_in_spheres",
    "wake_near_moving_tools",
    "wake_on_changed_ground",
    "wake_touching",
]

WAKE_SPHERE_SIZE = 4
"""Numbers in a wake sphere: a packed sphere, see `tools.tool_set`, in the map frame."""

_WAKE_DISPLACEMENT = 0.02
"""Displacement of a particle that wakes its contacts, in radii: a push of some ten times its
weight."""
_CONTACT_TOLERANCE = 1.005
"""Maximum distance of two particles in contact, in sums of radii."""
_TOOL_WAKE_MARGIN = 0.5
"""Gap to a moving tool that wakes a particle, in radii."""
_LOAD_WAKE_MARGIN = 0.1
"""Gap to a locked load that wakes both it and the particle, in radii."""
_LOOKAHEAD_STEPS = 4.0
"""Steps of relative motion that are added to these gaps: a fast tool would step over small sleeping
particles, or press those it woke against others that do not give way yet."""


@helper
def wake_touching(rows, pair_contacts, view, speed):  # type: ignore[no-untyped-def]
    """Wake the particles in contact with one that has left its wake reference.

    A particle that is locked to a tool wakes when one that touches it is faster than `speed` [m/s]
    relative to it.

    Args:
        rows: rows that moved in the step that ends.
        pair_contacts: `PairContactBlocks`.
        view: `ParticleColumns`; sleep state, sleep timer and wake reference are updated.
        speed: [m/s].

    Returns:
        Number of particles that woke.
    """
    position, velocity = view.position, view.velocity
    radius, contact_radius = view.radius, view.contact_radius
    sleep_state, wake_reference = view.sleep_state, view.wake_reference
    first, second = pair_contacts.first, pair_contacts.second
    begin, size = pair_contacts.begin, pair_contacts.size
    num_woken = 0
    for part in range(begin.size):
        for c in range(begin[part], begin[part] + size[part]):
            i, j = first[c], second[c]
            if (sleep_state[i] == AWAKE) == (sleep_state[j] == AWAKE):
                continue
            awake, asleep = (i, j) if sleep_state[i] == AWAKE else (j, i)
            reach = np.float64(contact_radius[i]) + np.float64(contact_radius[j])
            now2, reference2, displacement2, speed2 = 0.0, 0.0, 0.0, 0.0
            for axis in range(3):
                now2 += (position[awake, axis] - position[asleep, axis]) ** 2
                reference2 += (wake_reference[awake, axis] - position[asleep, axis]) ** 2
                displacement2 += (position[awake, axis] - wake_reference[awake, axis]) ** 2
                speed2 += (velocity[awake, axis] - velocity[asleep, axis]) ** 2
            if sleep_state[asleep] == ASLEEP_ON_MAP:
                wakes = (
                    displacement2 > (_WAKE_DISPLACEMENT * radius[awake]) ** 2
                    and min(now2, reference2) < (_CONTACT_TOLERANCE * reach) ** 2
                )
            else:
                wakes = speed2 > speed * speed and now2 < reach * reach
            if wakes:
                wake(asleep, view)
                num_woken += 1
    for i in rows:
        displacement2 = 0.0
        for axis in range(3):
            displacement2 += (position[i, axis] - wake_reference[i, axis]) ** 2
        if displacement2 > (_WAKE_DISPLACEMENT * radius[i]) ** 2:
            for axis in range(3):
                wake_reference[i, axis] = position[i, axis]
    return num_woken


@helper(allocates=True)
def wake_in_spheres(rows, view, spheres, woken):  # type: ignore[no-untyped-def]
    """Mark the particles whose surface is inside one of some spheres.

    Args:
        rows: sleeping rows.
        view: `ParticleColumns`.
        spheres: map frame [m], shape (n, WAKE_SPHERE_SIZE).
        woken: marks of `rows`, updated.
    """
    position = view.position
    low, high = np.full(3, 1e300), np.full(3, -1e300)
    for s in range(spheres.shape[0]):
        for axis in range(3):
            centre = spheres[s, SPHERE_CENTRE + axis]
            low[axis] = min(low[axis], centre - spheres[s, SPHERE_RADIUS])
            high[axis] = max(high[axis], centre + spheres[s, SPHERE_RADIUS])
    for k in range(rows.size):
        i = rows[k]
        r = np.float64(view.radius[i])
        if woken[k] or _is_outside_box(position, i, low, high, r):
            continue
        for s in range(spheres.shape[0]):
            dx = position[i, 0] - spheres[s, SPHERE_CENTRE]
            dy = position[i, 1] - spheres[s, SPHERE_CENTRE + 1]
            dz = position[i, 2] - spheres[s, SPHERE_CENTRE + 2]
            reach = r + spheres[s, SPHERE_RADIUS]
            if dx * dx + dy * dy + dz * dz < reach * reach:
                woken[k] = True
                break


@helper(forceinline=True)
def _is_outside_box(position, i, low, high, margin):  # type: ignore[no-untyped-def]
    """Return whether particle i is farther than a margin [m] outside a box along some axis."""
    outside = False
    for axis in range(3):
        p = position[i, axis]
        outside |= p < low[axis] - margin or p > high[axis] + margin
    return outside


@helper
def wake_on_changed_ground(rows, view, changed, ground, woken):  # type: ignore[no-untyped-def]
    """Mark the particles asleep on the map that are on a changed column or next to one.

    Args:
        rows: sleeping rows.
        view: `ParticleColumns`.
        changed: which columns changed, shape (rows, cols).
        ground: `Ground.frame`.
        woken: marks of `rows`, updated.
    """
    position = view.position
    last_row, last_col = changed.shape[0] - 1, changed.shape[1] - 1
    for k in range(rows.size):
        i = rows[k]
        if view.sleep_state[i] != ASLEEP_ON_MAP or woken[k]:
            continue
        r = np.float64(view.radius[i])
        u = (ground[0] - position[i, 0]) * ground[2]
        v = (ground[1] - position[i, 1]) * ground[2]
        r *= ground[2]
        top, bottom = int(max(np.floor(u - r), 0.0)), int(min(np.ceil(u + r), 1.0 * last_row))
        left, right = int(max(np.floor(v - r), 0.0)), int(min(np.ceil(v + r), 1.0 * last_col))
        for row in range(top, bottom + 1):
            for col in range(left, right + 1):
                woken[k] |= changed[row, col]


@helper
def wake_near_moving_tools(dt, rows, view, is_moving, tools, woken, wake_load):  # type: ignore[no-untyped-def]
    """Mark the particles that a moving tool, or their own moving tool, brings near plates.

    Args:
        dt: [s].
        rows: sleeping rows.
        view: `ParticleColumns`.
        is_moving: which tools move, shape (tools,).
        tools: `ToolMotion` of the step that begins.
        woken: marks of `rows`, updated.
        wake_load: tools whose locked load comes near another tool, shape (tools,), updated.
    """
    position, pose, sphere = view.position, tools.path[0], tools.sphere
    for k in range(rows.size):
        i = rows[k]
        own = locked_tool(view.sleep_state[i])
        for t in range(is_moving.size):
            if own == t or woken[k] or not (is_moving[t] or (own >= 0 and is_moving[own])):
                continue
            x, y, z = to_tool_frame(pose[t], position[i, 0], position[i, 1], position[i, 2])
            dx = x - sphere[t, SPHERE_CENTRE]
            dy = y - sphere[t, SPHERE_CENTRE + 1]
            dz = z - sphere[t, SPHERE_CENTRE + 2]
            vx, vy, vz = _tool_velocity_at(position, i, pose[t], tools.twist[t])
            if own >= 0:
                ux, uy, uz = _tool_velocity_at(position, i, pose[own], tools.twist[own])
                vx, vy, vz = vx - ux, vy - uy, vz - uz
            ahead = _LOOKAHEAD_STEPS * dt * np.sqrt(vx * vx + vy * vy + vz * vz)
            reach = (1.0 + _TOOL_WAKE_MARGIN) * view.radius[i] + ahead
            if dx * dx + dy * dy + dz * dz > (sphere[t, SPHERE_RADIUS] + reach) ** 2:
                continue
            low, high = tools.first_plate[t], tools.first_plate[t + 1]
            if _is_near_plate(tools.plates, low, high, x, y, z, reach):
                woken[k] = True
                if own >= 0:
                    wake_load[own] = True


@helper
def _is_near_plate(plates, low, high, x, y, z, reach):  # type: ignore[no-untyped-def]
    """Return whether a point of the tool frame is within reach [m] of a plate in low..high-1."""
    for p in range(low, high):
        a, b, h = plate_coordinates(plates, p, x, y, z)
        if abs(h) > reach:
            continue
        ca, cb, _ = closest_in_polygon(plates, p, a, b)
        if (a - ca) ** 2 + (b - cb) ** 2 + h * h < reach * reach:
            return True
    return False


@helper(forceinline=True)
def _tool_velocity_at(position, row, pose, twist):  # type: ignore[no-untyped-def]
    """Return the velocity [m/s], map axes, of a tool at the position of a particle."""
    x = position[row, 0] - pose[ORIGIN]
    y = position[row, 1] - pose[ORIGIN + 1]
    z = position[row, 2] - pose[ORIGIN + 2]
    return velocity_at(twist, x, y, z)


@helper(allocates=True)
def load_approaches_soil(dt, tool, tools, rows, view, woken):  # type: ignore[no-untyped-def]
    """Mark the particles asleep on the map that the locked load of a tool approaches.

    Args:
        dt: [s].
        tool: index of the tool.
        tools: `ToolMotion` of the step that begins.
        rows: sleeping rows.
        view: `ParticleColumns`.
        woken: marks of `rows`, updated.

    Returns:
        Whether the load comes near any soil, which unlocks it.
    """
    position, radius, sleep_state = view.position, view.radius, view.sleep_state
    pose, twist = tools.path[0, tool], tools.twist[tool]
    low, high, max_reach = np.full(3, 1e300), np.full(3, -1e300), 0.0
    for i in rows:
        if sleep_state[i] != locked_state(tool):
            continue
        vx, vy, vz = _tool_velocity_at(position, i, pose, twist)
        ahead = _LOOKAHEAD_STEPS * dt * np.sqrt(vx * vx + vy * vy + vz * vz)
        max_reach = max(max_reach, ahead + (1.0 + _LOAD_WAKE_MARGIN) * radius[i])
        for axis in range(3):
            low[axis] = min(low[axis], position[i, axis])
            high[axis] = max(high[axis], position[i, axis])
    is_near = False
    for k in range(rows.size):
        j = rows[k]
        if sleep_state[j] != ASLEEP_ON_MAP and not view.frozen[j]:
            continue
        reach = max_reach + radius[j]
        if _is_outside_box(position, j, low, high, reach):
            continue
        for i in rows:
            if sleep_state[i] != locked_state(tool):
                continue
            dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
            dz = position[i, 2] - position[j, 2]
            if dx * dx + dy * dy + dz * dz < reach * reach:
                is_near = True
                woken[k] |= sleep_state[j] == ASLEEP_ON_MAP
                break
    return is_near
