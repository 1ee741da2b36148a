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

from soil_sim.force.strength import add_force, column_at
from soil_sim.jit import helper
from soil_sim.vectors import cross, dot, length, minus, over, plus, point_at, times

__all__ = ["add_bearing", "bearing_capacity"]

_STRIPS = 8
"""Strips of a plate, and of the lip."""

_UPRIGHT = 0.3
"""What looks down less than this (-z of its normal) is not borne."""

_TOUCH = 0.01
"""Gap [m] up to which a plate touches: a column's height is a mean over what the tool cut."""

_EDGE = 0.04
"""Thickness of the lip [m]."""

_BESIDE = 1.5
"""Where the soil beside is looked for, in cells."""


@helper(inline="always")
def add_bearing(points, middle, columns, frame, strength, sums):  # type: ignore[no-untyped-def]
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
        body = plus(body, over(point_at(points, row, 1), float(len(points))))
    on = np.empty(plates * _STRIPS, dtype=np.int64)  # columns pressed on
    pads = np.empty((plates * _STRIPS, 7))  # where, the way it bears, the area [m^2]
    count = 0
    for k in range(plates):
        a, b = point_at(points, 2 * k, 1), point_at(points, 2 * k + 1, 1)
        c, d = point_at(points, 2 * k + 2, 1), point_at(points, 2 * k + 3, 1)
        out = cross(minus(b, a), times(0.5, minus(minus(plus(c, d), a), b)))
        area = length(out)
        if area < 1e-9:
            continue
        out = over(out, area)
        inward = dot(out, minus(body, a))
        if inward > 0.0:
            out = times(-1.0, out)
        # A plate alone has no outside; an upright one does not rest on what its columns hold.
        if abs(inward) < 1e-6 or out[2] > -_UPRIGHT:
            continue
        for strip in range(_STRIPS):
            share = (strip + 0.5) / _STRIPS
            at = times(0.5, plus(times(1.0 - share, plus(a, c)), times(share, plus(b, d))))
            i = column_at(at[0], at[1], frame)
            if i < 0:
                continue
            # The plate over the column's middle, against the column as the last tick left it.
            dx = frame[3] - i // frame[1] * frame[2] - at[0]
            dy = frame[4] - i % frame[1] * frame[2] - at[1]
            if columns.height[i] + _TOUCH > at[2] - (out[0] * dx + out[1] * dy) / out[2]:
                on[count] = i
                for axis in range(3):
                    pads[count, axis] = at[axis] - middle[axis]
                    pads[count, 3 + axis] = -out[axis]
                pads[count, 6] = area / _STRIPS
                count += 1
    if count:
        breadth = 0.0
        for n in range(count):
            breadth += pads[n, 6]
        breadth /= length(minus(point_at(points, 1, 1), point_at(points, 0, 1)))
        for n in range(count):
            x, y, z, nx, ny, nz, area = pads[n]
            force = area * bearing_capacity(on[n], breadth, 0.0, columns, strength)
            add_force(sums, (x, y, z), times(force, (nx, ny, nz)))
    _add_lip(points, middle, columns, frame, strength, sums)


@helper(inline="always")
def _add_lip(points, middle, columns, frame, strength, sums):  # type: ignore[no-untyped-def]
    """Add what bears the lip's edge, along its plate."""
    left, right = point_at(points, 0, 1), point_at(points, 1, 1)
    above = plus(point_at(points, 2, 1), point_at(points, 3, 1))
    up = times(0.5, minus(minus(above, left), right))
    long = length(up)
    if long < 1e-6 or up[2] < _UPRIGHT * long:
        return
    up = over(up, long)
    across = minus(right, left)
    width = length(across)
    level = math.hypot(across[0], across[1])
    if level < 1e-6:
        return
    # Beside: to either side of the lip, level.
    sx, sy = -across[1] / level * _BESIDE * frame[2], across[0] / level * _BESIDE * frame[2]
    for strip in range(_STRIPS):
        at = plus(left, times((strip + 0.5) / _STRIPS, across))
        i = column_at(at[0], at[1], frame)
        if i < 0 or columns.height[i] + _TOUCH <= at[2]:
            continue
        deep = math.inf
        for side in (-1.0, 1.0):
            j = column_at(at[0] + side * sx, at[1] + side * sy, frame)
            if j >= 0:
                deep = min(deep, columns.height[j] - at[2])
        deep = max(deep, 0.0) if deep < math.inf else 0.0
        force = _EDGE * width / _STRIPS * bearing_capacity(i, _EDGE, deep, columns, strength)
        add_force(sums, minus(at, middle), times(force, up))


@helper()
def bearing_capacity(i, breadth, deep, columns, strength):  # type: ignore[no-untyped-def]
    """Bearing capacity of column i [Pa], `deep` [m] below the soil beside.

    Loose soil as deep as the footing is broad has no cohesion.
    """
    firm = max(0.0, 1.0 - columns.bulk[i] * columns.metres_per_mm3 / breadth)
    kind = columns.soil[i] if firm > 0.0 else columns.loose_soil[i]
    cohesion = firm * strength[kind].cohesion[columns.moisture[i]]
    gamma = strength[kind].gamma
    carried = cohesion * strength[kind].n_c + gamma * deep * strength[kind].n_q
    return carried + 0.5 * breadth * gamma * strength[kind].n_gamma
