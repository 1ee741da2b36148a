"""Who must not rest any longer: what touches it has gone on, its ground changed, a tool comes by.

Rest needs support, and support that moves slowly is as bad as a blow. So waking goes by *way*, not
by speed: each one awake remembers the place where it was when those that sleep against it last
could count on it. Once it is farther from there than a small part of its radius, whom it touched
there or touches here wakes too, which goes on to their neighbours as these begin to move.
"""

from __future__ import annotations

import numpy as np

from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import to_tool_frame
from msg_bridge.kernels import kernel

__all__ = [
    "load_approaches_soil",
    "wake_in_spheres",
    "wake_near_moving_tools",
    "wake_on_changed_ground",
    "wake_touching",
]

_WAKE_DISPLACEMENT = 0.02
"""Way that wakes whom one touches, in radii: a push of some ten times a particle's weight."""
_CONTACT_TOLERANCE = 1.005
"""Farthest two touch, in sums of radii."""
_TOOL_WAKE_MARGIN = 0.5
"""How close a tool that moves comes by to wake a particle, in radii beyond touching."""
_LOAD_WAKE_MARGIN = 0.1
"""How close soil that rides comes by to wake or be woken, in radii beyond touching."""
_LOOKAHEAD_STEPS = 4.0
"""And in ways of a step: a fast tool would step over small ones asleep, or press those it woke
against others that do not give way yet."""


@kernel
def wake_touching(  # type: ignore[no-untyped-def]
    rows, pair_contacts, position, velocity, contact_radius, radius, speed, sleep_state, wake_reference, sleep_timer,
):  # fmt: skip
    """Wake who is touched by one that has gone its way.

    Soil that rides in a tool wakes when one that touches it is faster than `speed` [m/s], seen
    from it.

    Args:
        rows: who moved in the step that ends.
        contacts: `PairContactBlocks`.
        position, velocity, contact_radius, radius: of the store.
        speed: [m/s].
        resting, place, sleep_timer: of the store; updated.

    Returns:
        How many woke.
    """
    first, second, begin, size = (
        pair_contacts.first,
        pair_contacts.second,
        pair_contacts.begin,
        pair_contacts.size,
    )
    woken = 0
    for part in range(begin.size):
        for c in range(begin[part], begin[part] + size[part]):
            i, j = first[c], second[c]
            if (sleep_state[i] == 0) == (sleep_state[j] == 0):
                continue
            awake, asleep = (i, j) if sleep_state[i] == 0 else (j, i)
            reach = np.float64(contact_radius[i]) + np.float64(contact_radius[j])
            now, then, way, fast = 0.0, 0.0, 0.0, 0.0
            for axis in range(3):
                now += (position[awake, axis] - position[asleep, axis]) ** 2
                then += (wake_reference[awake, axis] - position[asleep, axis]) ** 2
                way += (position[awake, axis] - wake_reference[awake, axis]) ** 2
                fast += (velocity[awake, axis] - velocity[asleep, axis]) ** 2
            if sleep_state[asleep] == 1:
                wakes = (
                    way > (_WAKE_DISPLACEMENT * radius[awake]) ** 2
                    and min(now, then) < (_CONTACT_TOLERANCE * reach) ** 2
                )
            else:
                wakes = fast > speed * speed and now < reach * reach
            if wakes:
                sleep_state[asleep] = 0
                sleep_timer[asleep] = np.float32(0.0)
                for axis in range(3):
                    wake_reference[asleep, axis] = position[asleep, axis]
                woken += 1
    for i in rows:
        way = 0.0
        for axis in range(3):
            way += (position[i, axis] - wake_reference[i, axis]) ** 2
        if way > (_WAKE_DISPLACEMENT * radius[i]) ** 2:
            for axis in range(3):
                wake_reference[i, axis] = position[i, axis]
    return woken


@kernel
def wake_in_spheres(rows, position, radius, spheres, woken):  # type: ignore[no-untyped-def]
    """Mark whose surface is within reach of a spot."""
    low, high = np.full(3, 1e300), np.full(3, -1e300)
    for s in range(spheres.shape[0]):
        for axis in range(3):
            low[axis] = min(low[axis], spheres[s, axis] - spheres[s, 3])
            high[axis] = max(high[axis], spheres[s, axis] + spheres[s, 3])
    for k in range(rows.size):
        i = rows[k]
        r = np.float64(radius[i])
        outside = False
        for axis in range(3):
            p = position[i, axis]
            outside |= p < low[axis] - r or p > high[axis] + r
        if outside or woken[k]:
            continue
        for s in range(spheres.shape[0]):
            dx, dy = position[i, 0] - spheres[s, 0], position[i, 1] - spheres[s, 1]
            dz, near = position[i, 2] - spheres[s, 2], r + spheres[s, 3]
            if dx * dx + dy * dy + dz * dz < near * near:
                woken[k] = True
                break


@kernel
def wake_on_changed_ground(rows, position, radius, sleep_state, changed, ground, woken):  # type: ignore[no-untyped-def]
    """Mark who lies on a column that changed, or beside one."""
    last_row, last_col = changed.shape[0] - 1, changed.shape[1] - 1
    for k in range(rows.size):
        i = rows[k]
        if sleep_state[i] != 1 or woken[k]:
            continue
        r = np.float64(radius[i])
        u = (ground[0] - position[i, 0]) * ground[2]
        v = (ground[1] - position[i, 1]) * ground[2]
        r *= ground[2]
        top, bottom = int(max(np.floor(u - r), 0.0)), int(min(np.ceil(u + r), 1.0 * last_row))
        left, right = int(max(np.floor(v - r), 0.0)), int(min(np.ceil(v + r), 1.0 * last_col))
        for row in range(top, bottom + 1):
            for col in range(left, right + 1):
                woken[k] |= changed[row, col]


@kernel
def wake_near_moving_tools(  # type: ignore[no-untyped-def]
    dt, rows, position, radius, sleep_state, moving, pose, twist, sphere, plates, first,
    woken, wake_load,
):  # fmt: skip
    """Mark whom a tool comes by within `dt` [s], and the tools whose load comes by another one."""
    for k in range(rows.size):
        i = rows[k]
        own = sleep_state[i] - 2
        for t in range(moving.size):
            if own == t or woken[k] or not (moving[t] or (own >= 0 and moving[own])):
                continue
            x, y, z = to_tool_frame(pose[t], position[i, 0], position[i, 1], position[i, 2])
            dx, dy, dz = x - sphere[t, 0], y - sphere[t, 1], z - sphere[t, 2]
            vx, vy, vz = _tool_velocity_at(position, i, pose, twist, t)
            if own >= 0:
                ux, uy, uz = _tool_velocity_at(position, i, pose, twist, own)
                vx, vy, vz = vx - ux, vy - uy, vz - uz
            ahead = _LOOKAHEAD_STEPS * dt * np.sqrt(vx * vx + vy * vy + vz * vz)
            reach = (1.0 + _TOOL_WAKE_MARGIN) * radius[i] + ahead
            if dx * dx + dy * dy + dz * dz > (sphere[t, 3] + reach) ** 2:
                continue
            for p in range(first[t], first[t + 1]):
                a, b, h = plate_coordinates(plates, p, x, y, z)
                if abs(h) > reach:
                    continue
                ca, cb, _ = closest_in_polygon(plates, p, a, b)
                if (a - ca) ** 2 + (b - cb) ** 2 + h * h < reach * reach:
                    woken[k] = True
                    if own >= 0:
                        wake_load[own] = True
                    break


@kernel
def _tool_velocity_at(position, row, pose, twist, t):  # type: ignore[no-untyped-def]
    """Of tool `t` at a particle's place [m/s]."""
    x = position[row, 0] - pose[t, 9]
    y = position[row, 1] - pose[t, 10]
    z = position[row, 2] - pose[t, 11]
    return (
        twist[t, 0] + twist[t, 4] * z - twist[t, 5] * y,
        twist[t, 1] + twist[t, 5] * x - twist[t, 3] * z,
        twist[t, 2] + twist[t, 3] * y - twist[t, 4] * x,
    )


@kernel
def load_approaches_soil(  # type: ignore[no-untyped-def]
    dt, number, pose, twist, rows, position, radius, sleep_state, frozen, woken
):
    """Mark who sleeps on the map where soil that rides in tool `number` comes by within `dt` [s].

    Args:
        rows: who sleeps, and who is frozen.
        woken: of `rows`; updated.

    Returns:
        Whether anyone is there: then that soil rides no longer.
    """
    low, high, most = np.full(3, 1e300), np.full(3, -1e300), 0.0
    for i in rows:
        if sleep_state[i] != number + 2:
            continue
        vx, vy, vz = _tool_velocity_at(position, i, pose, twist, number)
        ahead = _LOOKAHEAD_STEPS * dt * np.sqrt(vx * vx + vy * vy + vz * vz)
        most = max(most, ahead + (1.0 + _LOAD_WAKE_MARGIN) * radius[i])
        for axis in range(3):
            low[axis] = min(low[axis], position[i, axis])
            high[axis] = max(high[axis], position[i, axis])
    found = False
    for k in range(rows.size):
        j = rows[k]
        if sleep_state[j] != 1 and not frozen[j]:
            continue
        reach = most + radius[j]
        outside = False
        for axis in range(3):
            p = position[j, axis]
            outside |= p < low[axis] - reach or p > high[axis] + reach
        if outside:
            continue
        for i in rows:
            if sleep_state[i] != number + 2:
                continue
            dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
            dz = position[i, 2] - position[j, 2]
            if dx * dx + dy * dy + dz * dz < reach * reach:
                found = True
                woken[k] |= sleep_state[j] == 1
                break
    return found
