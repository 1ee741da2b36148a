"""What bears a tool: soil under its plates and under its lip, as much as it can carry.

A tool that leans on the ground is borne by what it touches, whether it moves or not. Each outside
of a plate that looks down and touches soil carries the bearing capacity of a strip footing, square
to the plate; the lip, a strip as thick as the edge is blunt, carries it along its plate::

    q = c N_c + q_0 N_q + gamma B N_gamma / 2,    N_q = exp(pi tan phi) tan^2(pi / 4 + phi / 2),
    N_c = (N_q - 1) cot phi,                      N_gamma = 2 (N_q + 1) tan phi

(Vesic, Analysis of ultimate loads of shallow foundations, J. Soil Mech. Found. Div. ASCE 99, SM1,
1973), B the breadth pressed on, q_0 the weight of the soil beside, down to the footing: on its
lower side, to which it would yield. It is told in every tick, as the most that the soil carries;
the machine takes of it what it leans with.
"""

from __future__ import annotations

import math

import numpy as np

from msg_bridge.kernels import helper
from soil_sim.tool_force.strength_table import add_force, column_index_at
from soil_sim.vec3 import add, cross, divide, dot, key_point, norm, scale, subtract

__all__ = ["add_bearing_force", "bearing_capacity"]

_NUM_STRIPS = 8
"""Strips of a plate, and of the lip."""

_MIN_DOWNWARD_NORMAL = 0.3
"""What looks down less than this (-z of its normal) is not borne."""

_CONTACT_GAP = 0.01
"""Gap [m] up to which a plate touches: a column's height is a mean over what the tool cut."""

_EDGE_THICKNESS = 0.04
"""Thickness of the lip [m]."""

_SURCHARGE_DISTANCE_CELLS = 1.5
"""Where the soil beside is looked for, in cells."""


@helper(inline="always")
def add_bearing_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add what can bear a tool at the end of its tick; places from `middle`.

    Args:
        points: start and end of its key points [m], shape (rows, 2, 3), lip first.
        middle: where places count from [m].
        columns, frame: of the terrain.
        strength: of its soils.
        sums: of `add_force`.
    """
    plates = len(points) // 2 - 1
    body = (0.0, 0.0, 0.0)
    for row in range(len(points)):
        body = add(body, divide(key_point(points, row, 1), float(len(points))))
    on = np.empty(plates * _NUM_STRIPS, dtype=np.int64)  # columns pressed on
    pads = np.empty((plates * _NUM_STRIPS, 7))  # where, the way it bears, the area [m^2]
    count = 0
    for k in range(plates):
        a, b = key_point(points, 2 * k, 1), key_point(points, 2 * k + 1, 1)
        c, d = key_point(points, 2 * k + 2, 1), key_point(points, 2 * k + 3, 1)
        out = cross(subtract(b, a), scale(0.5, subtract(subtract(add(c, d), a), b)))
        area = norm(out)
        if area < 1e-9:
            continue
        out = divide(out, area)
        inward = dot(out, subtract(body, a))
        if inward > 0.0:
            out = scale(-1.0, out)
        # A plate alone has no outside; an upright one does not rest on what its columns hold.
        if abs(inward) < 1e-6 or out[2] > -_MIN_DOWNWARD_NORMAL:
            continue
        for strip in range(_NUM_STRIPS):
            share = (strip + 0.5) / _NUM_STRIPS
            at = scale(0.5, add(scale(1.0 - share, add(a, c)), scale(share, add(b, d))))
            i = column_index_at(at[0], at[1], grid_layout)
            if i < 0:
                continue
            # The plate over the column's middle, against the column as the last tick left it.
            dx = grid_layout[3] - i // grid_layout[1] * grid_layout[2] - at[0]
            dy = grid_layout[4] - i % grid_layout[1] * grid_layout[2] - at[1]
            if columns.height[i] + _CONTACT_GAP > at[2] - (out[0] * dx + out[1] * dy) / out[2]:
                on[count] = i
                for axis in range(3):
                    pads[count, axis] = at[axis] - origin[axis]
                    pads[count, 3 + axis] = -out[axis]
                pads[count, 6] = area / _NUM_STRIPS
                count += 1
    if count:
        footing_width = 0.0
        for n in range(count):
            footing_width += pads[n, 6]
        footing_width /= norm(subtract(key_point(points, 1, 1), key_point(points, 0, 1)))
        for n in range(count):
            x, y, z, nx, ny, nz, area = pads[n]
            force = area * bearing_capacity(on[n], footing_width, 0.0, columns, strength)
            add_force(sums, (x, y, z), scale(force, (nx, ny, nz)))
    _add_edge_bearing(points, origin, columns, grid_layout, strength, sums)


@helper(inline="always")
def _add_edge_bearing(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add what bears the lip's edge, along its plate."""
    left, right = key_point(points, 0, 1), key_point(points, 1, 1)
    above = add(key_point(points, 2, 1), key_point(points, 3, 1))
    up = scale(0.5, subtract(subtract(above, left), right))
    long = norm(up)
    if long < 1e-6 or up[2] < _MIN_DOWNWARD_NORMAL * long:
        return
    up = divide(up, long)
    across = subtract(right, left)
    width = norm(across)
    level = math.hypot(across[0], across[1])
    if level < 1e-6:
        return
    # Beside: to either side of the lip, level.
    sx, sy = (
        -across[1] / level * _SURCHARGE_DISTANCE_CELLS * grid_layout[2],
        across[0] / level * _SURCHARGE_DISTANCE_CELLS * grid_layout[2],
    )
    for strip in range(_NUM_STRIPS):
        at = add(left, scale((strip + 0.5) / _NUM_STRIPS, across))
        i = column_index_at(at[0], at[1], grid_layout)
        if i < 0 or columns.height[i] + _CONTACT_GAP <= at[2]:
            continue
        surcharge_depth = math.inf
        for side in (-1.0, 1.0):
            j = column_index_at(at[0] + side * sx, at[1] + side * sy, grid_layout)
            if j >= 0:
                surcharge_depth = min(surcharge_depth, columns.height[j] - at[2])
        surcharge_depth = max(surcharge_depth, 0.0) if surcharge_depth < math.inf else 0.0
        force = (
            _EDGE_THICKNESS
            * width
            / _NUM_STRIPS
            * bearing_capacity(i, _EDGE_THICKNESS, surcharge_depth, columns, strength)
        )
        add_force(sums, subtract(at, origin), scale(force, up))


@helper
def bearing_capacity(i, footing_width, surcharge_depth, columns, strength):  # type: ignore[no-untyped-def]
    """Bearing capacity of column i [Pa], `deep` [m] below the soil beside.

    Loose soil as deep as the footing is broad has no cohesion.
    """
    firm = max(0.0, 1.0 - columns.bulk[i] * columns.metres_per_mm3 / footing_width)
    kind = columns.soil[i] if firm > 0.0 else columns.loose_soil[i]
    cohesion = firm * strength[kind].cohesion[columns.moisture[i]]
    gamma = strength[kind].gamma
    carried = cohesion * strength[kind].n_c + gamma * surcharge_depth * strength[kind].n_q
    return carried + 0.5 * footing_width * gamma * strength[kind].n_gamma
