"""Soil at rest in a tool that rides in it as one body: who does, and how it goes along."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import to_tool_frame
from msg_bridge.kernels import kernel

__all__ = ["move_locked_loads", "trace_support"]

_CONTACT_TOLERANCE = 1.02
"""Farthest two touch, in sums of radii; one and a plate or the ground, in radii."""
_SUPPORTED_BY_TOOL = 2
_SUPPORTED_OTHERWISE = 4


@kernel
def trace_support(  # type: ignore[no-untyped-def]
    number, rows, sleep_ready, position, contact_radius, sleep_state, frozen, pair_contacts, plate_contacts, ground_contacts, tools,
    tool_supported, otherwise_supported,
):  # fmt: skip
    """Mark who of the calm rests on tool `number`, and who on something else; some on both.

    Support is followed from contact to contact: a tube without a floor holds nothing, and soil in
    a bucket that leans on soil outside does not go along with it.

    Args:
        rows, calm: who is awake, and which of them are calm, shape (rows,).
        position ... frozen: of the store.
        contacts, walls, grounds: `PairContactBlocks`, `PlateCandidates` and `GroundContacts`.
        tools: `ToolMotion`, at the end of the step.
        held, grounded: out, shape (rows,).
    """
    state = np.zeros(sleep_state.size, np.uint8)
    for k in range(rows.size):
        if sleep_ready[k]:
            state[rows[k]] = 1
    plane, pose = ground_contacts.plane, tools.path[tools.path.shape[0] - 1]
    for c in range(ground_contacts.row.size):
        i = ground_contacts.row[c]
        if state[i] != 0:
            distance = plane[c, 0] * position[i, 0] + plane[c, 1] * position[i, 1]
            distance += plane[c, 2] * position[i, 2] - plane[c, 3]
            if distance < _CONTACT_TOLERANCE * contact_radius[i]:
                state[i] |= np.uint8(_SUPPORTED_OTHERWISE)
    tool_of_plate = tools.tool_of_plate
    for c in range(plate_contacts.row.size):
        i, p = plate_contacts.row[c], plate_contacts.plate[c]
        if state[i] == 0:
            continue
        x, y, z = to_tool_frame(
            pose[tool_of_plate[p]], position[i, 0], position[i, 1], position[i, 2]
        )
        a, b, h = plate_coordinates(tools.plates, p, x, y, z)
        ca, cb, _ = closest_in_polygon(tools.plates, p, a, b)
        if (a - ca) ** 2 + (b - cb) ** 2 + h * h < (_CONTACT_TOLERANCE * contact_radius[i]) ** 2:
            state[i] |= np.uint8(
                _SUPPORTED_BY_TOOL if tool_of_plate[p] == number else _SUPPORTED_OTHERWISE
            )
    first, second, begin, size = (
        pair_contacts.first,
        pair_contacts.second,
        pair_contacts.begin,
        pair_contacts.size,
    )
    spreads = True
    while spreads:
        spreads = False
        for part in range(begin.size):
            for c in range(begin[part], begin[part] + size[part]):
                i, j = first[c], second[c]
                if state[i] == state[j]:
                    continue
                reach = _CONTACT_TOLERANCE * (
                    np.float64(contact_radius[i]) + np.float64(contact_radius[j])
                )
                dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
                dz = position[i, 2] - position[j, 2]
                if dx * dx + dy * dy + dz * dz > reach * reach:
                    continue
                for turn in range(2):
                    one, other = (i, j) if turn == 0 else (j, i)
                    if state[one] == 0:
                        continue
                    support = state[other] & np.uint8(_SUPPORTED_BY_TOOL | _SUPPORTED_OTHERWISE)
                    if sleep_state[other] == number + 2:
                        support = np.uint8(_SUPPORTED_BY_TOOL)
                    elif sleep_state[other] != 0 or frozen[other]:
                        support = np.uint8(_SUPPORTED_OTHERWISE)
                    if support & ~state[one] != 0:
                        state[one] |= support
                        spreads = True
    for k in range(rows.size):
        otherwise_supported[k] = state[rows[k]] & _SUPPORTED_OTHERWISE != 0
        tool_supported[k] = state[rows[k]] & _SUPPORTED_BY_TOOL != 0


@kernel
def move_locked_loads(  # type: ignore[no-untyped-def]
    locked_rows,
    tool,
    number,
    pose,
    twist,
    wake_reference,
    mass,
    position,
    velocity,
    angular_velocity,
):
    """Take who rides in tool `number` along to its packed `pose`.

    Returns:
        Mass of these [kg], and their centre of mass from the origin of the tool's frame [m], map
        axes, shape (3,).
    """
    load, moment = 0.0, np.zeros(3)
    ax, ay, az = twist[3], twist[4], twist[5]
    for k in range(locked_rows.size):
        if tool[k] != number:
            continue
        i = locked_rows[k]
        px, py, pz = wake_reference[i, 0], wake_reference[i, 1], wake_reference[i, 2]
        x = pose[0] * px + pose[1] * py + pose[2] * pz
        y = pose[3] * px + pose[4] * py + pose[5] * pz
        z = pose[6] * px + pose[7] * py + pose[8] * pz
        position[i, 0], position[i, 1], position[i, 2] = pose[9] + x, pose[10] + y, pose[11] + z
        velocity[i, 0] = twist[0] + ay * z - az * y
        velocity[i, 1] = twist[1] + az * x - ax * z
        velocity[i, 2] = twist[2] + ax * y - ay * x
        angular_velocity[i, 0], angular_velocity[i, 1], angular_velocity[i, 2] = ax, ay, az
        m = np.float64(mass[i])
        load += m
        moment[0] += m * x
        moment[1] += m * y
        moment[2] += m * z
    return load, moment / load
