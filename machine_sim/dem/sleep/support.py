"""Support: whether particles at rest rest on a tool, on something else, or on both.

Support spreads from contact to contact. So a tube without a floor supports nothing, and soil in a
bucket that leans on soil outside does not move with the bucket.
"""

from __future__ import annotations

import numpy as np

from machine_sim.dem.sleep.sleep_state import AWAKE, locked_state
from machine_sim.dem.tools.plane import signed_distance
from machine_sim.dem.tools.plates import closest_in_polygon, plate_coordinates
from machine_sim.dem.tools.pose import to_tool_frame
from msg_bridge.kernels import helper, kernel

__all__ = ["trace_support"]

_CONTACT_TOLERANCE = 1.02
"""Maximum distance of two particles in contact, in sums of radii; of a particle and a plate or the
ground, in radii."""

_SLEEP_READY, _ON_TOOL, _ON_OTHER = np.uint8(1), np.uint8(2), np.uint8(4)
"""Support bits of a particle: it may fall asleep; it rests on the tool; on anything else."""
_ON_ANY = np.uint8(6)


@kernel
def trace_support(tool, rows, sleep_ready, view, contacts, tools, on_tool, on_other):  # type: ignore[no-untyped-def]
    """Mark which particles that may fall asleep rest on a tool and which on something else.

    Args:
        tool: index of the tool.
        rows: awake rows.
        sleep_ready: which of `rows` may fall asleep.
        view: `ParticleColumns`.
        contacts: `StepContacts`.
        tools: `ToolMotion` at the end of the step.
        on_tool, on_other: out, marks of `rows`; a particle can have both.
    """
    support = np.zeros(view.sleep_state.size, np.uint8)
    for k in range(rows.size):
        if sleep_ready[k]:
            support[rows[k]] = _SLEEP_READY
    _add_ground_support(view, contacts.ground_contacts, support)
    _add_plate_support(tool, view, contacts.plate_contacts, tools, support)
    while _spread_support(tool, view, contacts.pair_contacts, support):
        pass
    for k in range(rows.size):
        on_other[k] = support[rows[k]] & _ON_OTHER != 0
        on_tool[k] = support[rows[k]] & _ON_TOOL != 0


@helper
def _add_ground_support(view, ground_contacts, support):  # type: ignore[no-untyped-def]
    """Set the bits of the particles that touch the ground."""
    position = view.position
    for c in range(ground_contacts.row.size):
        i = ground_contacts.row[c]
        if support[i] != 0:
            distance = signed_distance(
                ground_contacts.plane[c], position[i, 0], position[i, 1], position[i, 2]
            )
            if distance < _CONTACT_TOLERANCE * view.contact_radius[i]:
                support[i] |= _ON_OTHER


@helper
def _add_plate_support(tool, view, plate_contacts, tools, support):  # type: ignore[no-untyped-def]
    """Set the bits of the particles that touch a plate, of the tool or of another."""
    position, pose = view.position, tools.path[tools.path.shape[0] - 1]
    for c in range(plate_contacts.row.size):
        i, p = plate_contacts.row[c], plate_contacts.plate[c]
        if support[i] == 0:
            continue
        owner = tools.tool_of_plate[p]
        x, y, z = to_tool_frame(pose[owner], position[i, 0], position[i, 1], position[i, 2])
        a, b, h = plate_coordinates(tools.plates, p, x, y, z)
        ca, cb, _ = closest_in_polygon(tools.plates, p, a, b)
        reach = _CONTACT_TOLERANCE * view.contact_radius[i]
        if (a - ca) ** 2 + (b - cb) ** 2 + h * h < reach**2:
            support[i] |= _ON_TOOL if owner == tool else _ON_OTHER


@helper
def _spread_support(tool, view, pair_contacts, support):  # type: ignore[no-untyped-def]
    """Hand support on across each contact once; return whether any particle gained a bit."""
    position, contact_radius = view.position, view.contact_radius
    first, second = pair_contacts.first, pair_contacts.second
    begin, size = pair_contacts.begin, pair_contacts.size
    spreads = False
    for part in range(begin.size):
        for c in range(begin[part], begin[part] + size[part]):
            i, j = first[c], second[c]
            if support[i] == support[j]:
                continue
            reach = _CONTACT_TOLERANCE * (
                np.float64(contact_radius[i]) + np.float64(contact_radius[j])
            )
            dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
            dz = position[i, 2] - position[j, 2]
            if dx * dx + dy * dy + dz * dz > reach * reach:
                continue
            for direction in range(2):
                receiver, giver = (i, j) if direction == 0 else (j, i)
                if support[receiver] == 0:
                    continue
                given = support[giver] & _ON_ANY
                if view.sleep_state[giver] == locked_state(tool):
                    given = _ON_TOOL
                elif view.sleep_state[giver] != AWAKE or view.frozen[giver]:
                    given = _ON_OTHER
                if given & ~support[receiver] != 0:
                    support[receiver] |= given
                    spreads = True
    return spreads
