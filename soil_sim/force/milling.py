"""What resists a drum whose picks mill soil or rock: a torque, and a thrust out of the face.

A drum that stands takes nothing off. Every flat of it that has ground before it is borne by that,
whichever way it looks (`soil_sim.force.bearing`).

The drum is cut into flats round it and strips along it. A flat whose middle is in the ground takes
off, in a tick, what the drum advances square to it; the picks that pass there do the work

    W = e * area * advance,

with the *specific energy* e [J/m^3] of the ground. Over the way w that the picks go in the tick the
force against them is W / w, and the force out of the face is that times a ratio.

- **Rock.** One pick in a groove of depth d, as deep as you like: Goktan's peak force
  (`soil_sim.force.pick`) over the groove's section d^2 tan(beta) does not depend on d,

      e = m 4 pi sigma_t sin^2(a) / (cos(a) tan(beta)),    a = theta / 2 + psi,

  with the breakout angle beta and m the mean of the force over its peak. For sigma_t = 3 MPa it is
  8 MJ/m^3 or 2.2 kWh/m^3, within what is measured on a sandstone of 40 MPa at favourable spacing
  (Bilgin, Copur, Balci, Mechanical Excavation in Mining and Civil Industries, 2013, ch. 4).
- **Soil.** It is sheared off in passive failure and lifted over the drum:
  e = 2 c sqrt(K_p) + gamma D, K_p = tan^2(pi/4 + phi/2).
"""

from __future__ import annotations

import math

from soil_sim.force.bearing import bearing_capacity
from soil_sim.force.pick import goktan_force
from soil_sim.force.strength import add_force, column_at
from soil_sim.jit import helper, kernel
from soil_sim.vectors import dot, length, minus, over, plus, point_at, times

__all__ = ["add_milling", "add_standing", "is_ring", "rock_energy"]

_STRIPS = 4
"""Strips along the drum."""
_TIP = math.radians(80.0)
_FRICTION = math.radians(10.0)
_BREAKOUT = math.radians(60.0)
"""Breakout angle of a groove, from the normal of the face."""
_MEAN = 0.4
"""Mean cutting force of a pick over its peak: chips break off."""
_THRUST = 1.0
"""Force out of the face over the force against the picks."""
_OUTSIDE = 0.01
"""How far outside the tips the ground is looked for [m]."""


@kernel()
def rock_energy(tensile):  # type: ignore[no-untyped-def]
    """Specific energy [J/m^3] of rock with a tensile strength [Pa] under picks."""
    return _MEAN * goktan_force(1.0, _TIP, tensile, _FRICTION) / math.tan(_BREAKOUT)


@helper(inline="always")
def is_ring(points):  # type: ignore[no-untyped-def]
    """Whether key points, shape (rows, 2, 3), are a drum's: the last pair is where the first is."""
    rows = len(points)
    if rows < 8:
        return False
    for side in range(2):
        for axis in range(3):
            if abs(points[side, 1, axis] - points[rows - 2 + side, 1, axis]) > 1e-6:
                return False
    return True


@helper()
def _facet(points, k, axis):  # type: ignore[no-untyped-def]
    """Facet `k` of a drum between two pairs of key points, at the end of the tick.

    Returns:
        (middle of its left edge, of its right one, unit vector out from `axis`, whether it lies on
        the axis and has none).
    """
    left = times(0.5, plus(point_at(points, 2 * k, 1), point_at(points, 2 * k + 2, 1)))
    right = times(0.5, plus(point_at(points, 2 * k + 1, 1), point_at(points, 2 * k + 3, 1)))
    out = minus(times(0.5, plus(left, right)), axis)
    distance = length(out)
    flat = distance < 1e-6
    return left, right, out if flat else over(out, distance), flat


@helper()
def _column_beside(at, out, columns, frame):  # type: ignore[no-untyped-def]
    """The column whose ground touches a facet there from outside, -1 if none does."""
    x, y = at[0] + _OUTSIDE * out[0], at[1] + _OUTSIDE * out[1]
    i = column_at(x, y, frame)
    if i < 0 or columns.height[i] <= at[2] + _OUTSIDE * out[2]:
        return -1
    return i


@helper(inline="always")
def _axis(points, pairs, time):  # type: ignore[no-untyped-def]
    """Mean of a drum's key points [m], at the start (0) or the end (1) of the tick."""
    axis = (0.0, 0.0, 0.0)
    for row in range(2 * pairs):
        axis = plus(axis, over(point_at(points, row, time), 2.0 * pairs))
    return axis


@helper(inline="always")
def add_standing(points, middle, columns, frame, strength, sums):  # type: ignore[no-untyped-def]
    """Add what bears a drum that does not spin; arguments as in `add_milling`."""
    pairs = len(points) // 2 - 1
    axis = _axis(points, pairs, 1)
    for k in range(pairs):
        left, right, out, flat = _facet(points, k, axis)
        if flat:
            continue
        width = minus(right, left)
        breadth = length(minus(point_at(points, 2 * k + 2, 1), point_at(points, 2 * k, 1)))
        area = breadth * length(width) / _STRIPS
        for strip in range(_STRIPS):
            at = plus(left, times((strip + 0.5) / _STRIPS, width))
            i = _column_beside(at, out, columns, frame)
            if i < 0:
                continue
            force = area * bearing_capacity(i, breadth, 0.0, columns, strength)
            add_force(sums, minus(at, middle), times(-force, out))


@helper(inline="always")
def add_milling(points, middle, columns, frame, strength, sums):  # type: ignore[no-untyped-def]
    """Add what resists the picks of a drum in a tick; places from `middle`.

    Args:
        points: start and end of its key points [m], shape (rows, 2, 3), all round, left ends first,
            the last pair where the first is.
        middle: where places count from [m].
        columns, frame: of the terrain.
        strength: of its soils.
        sums: of `add_force`.
    """
    pairs = len(points) // 2 - 1
    axis = _axis(points, pairs, 1)
    advance = minus(axis, _axis(points, pairs, 0))
    first = times(0.5, plus(point_at(points, 0, 1), point_at(points, 1, 1)))
    radius = length(minus(first, axis))
    for k in range(pairs):
        left, right, out, flat = _facet(points, k, axis)
        if flat:
            continue
        depth = dot(advance, out)
        if depth <= 0.0:
            continue
        corners = point_at(points, 2 * k, 0)
        for row in range(2 * k + 1, 2 * k + 4):
            corners = plus(corners, point_at(points, row, 0))
        way = minus(minus(times(0.5, plus(left, right)), times(0.25, corners)), advance)
        spun = length(way)
        if spun < 1e-6:
            continue
        across = minus(point_at(points, 2 * k + 2, 1), point_at(points, 2 * k, 1))
        width = minus(right, left)
        area = length(across) * length(width) / _STRIPS
        for strip in range(_STRIPS):
            at = plus(left, times((strip + 0.5) / _STRIPS, width))
            i = _column_beside(at, out, columns, frame)
            if i < 0:
                continue
            energy = _energy(i, at[2], 2.0 * radius, columns, strength)
            against = energy * area * depth / spun
            force = minus(over(times(-against, way), spun), times(_THRUST * against, out))
            add_force(sums, minus(at, middle), force)


@helper(inline="always")
def _energy(i, z, diameter, columns, strength):  # type: ignore[no-untyped-def]
    """Specific energy [J/m^3] of the ground of a column at a height [m]."""
    cover = columns.bulk[i] * columns.metres_per_mm3
    if cover > 0.0 and z > columns.height[i] - cover:  # in loose soil
        kind = columns.loose_soil[i]
        density = columns.loose[i] / columns.bulk[i]
        return strength[kind].gamma * density * diameter
    kind = columns.soil[i]
    if strength[kind].tensile > 0.0:
        return rock_energy(strength[kind].tensile)
    passive = math.tan(math.pi / 4 + 0.5 * strength[kind].phi)
    cohesion = strength[kind].cohesion[columns.moisture[i]]
    return 2.0 * cohesion * passive + strength[kind].gamma * diameter
