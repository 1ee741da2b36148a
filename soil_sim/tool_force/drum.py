"""What resists a drum whose picks mill soil or rock: a torque, and a thrust out of the face.

A drum that stands takes nothing off. Every flat of it that has ground before it is borne by that,
whichever way it looks (`soil_sim.tool_force.bearing_capacity`).

The drum is cut into flats round it and strips along it. A flat whose middle is in the ground takes
off, in a tick, what the drum advances square to it; the picks that pass there do the work

    W = e * area * advance,

with the *specific energy* e [J/m^3] of the ground. Over the way w that the picks go in the tick the
force against them is W / w, and the force out of the face is that times a ratio.

- **Rock.** One pick in a groove of depth d, as deep as you like: Goktan's peak force
  (`soil_sim.tool_force.rock_pick`) over the groove's section d^2 tan(beta) does not depend on d,

      e = m 4 pi sigma_t sin^2(a) / (cos(a) tan(beta)),    a = theta / 2 + psi,

  with the breakout angle beta and m the mean of the force over its peak. For sigma_t = 3 MPa it is
  8 MJ/m^3 or 2.2 kWh/m^3, within what is measured on a sandstone of 40 MPa at favourable spacing
  (Bilgin, Copur, Balci, Mechanical Excavation in Mining and Civil Industries, 2013, ch. 4).
- **Soil.** It is sheared off in passive failure and lifted over the drum:
  e = 2 c sqrt(K_p) + gamma D, K_p = tan^2(pi/4 + phi/2).
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper, kernel
from soil_sim.tool_force.bearing_capacity import bearing_capacity
from soil_sim.tool_force.rock_pick import goktan_force
from soil_sim.tool_force.strength_table import add_force, column_index_at
from soil_sim.vec3 import add, divide, dot, key_point, norm, scale, subtract

__all__ = ["add_milling_force", "add_stationary_drum_force", "is_drum", "rock_specific_energy"]

_NUM_STRIPS = 4
"""Strips along the drum."""
_PICK_TIP_ANGLE = math.radians(80.0)
_PICK_FRICTION = math.radians(10.0)
_BREAKOUT_ANGLE = math.radians(60.0)
"""Breakout angle of a groove, from the normal of the face."""
_MEAN_TO_PEAK_RATIO = 0.4
"""Mean cutting force of a pick over its peak: chips break off."""
_THRUST_RATIO = 1.0
"""Force out of the face over the force against the picks."""
_PROBE_DISTANCE = 0.01
"""How far outside the tips the ground is looked for [m]."""


@kernel
def rock_specific_energy(tensile_strength):  # type: ignore[no-untyped-def]
    """Specific energy [J/m^3] of rock with a tensile strength [Pa] under picks."""
    return (
        _MEAN_TO_PEAK_RATIO
        * goktan_force(1.0, _PICK_TIP_ANGLE, tensile_strength, _PICK_FRICTION)
        / math.tan(_BREAKOUT_ANGLE)
    )


@helper(inline="always")
def is_drum(points):  # type: ignore[no-untyped-def]
    """Whether key points, shape (rows, 2, 3), are a drum's: the last pair is where the first is."""
    rows = len(points)
    if rows < 8:
        return False
    for side in range(2):
        for axis in range(3):
            if abs(points[side, 1, axis] - points[rows - 2 + side, 1, axis]) > 1e-6:
                return False
    return True


@helper
def _facet(points, k, axis):  # type: ignore[no-untyped-def]
    """Facet `k` of a drum between two pairs of key points, at the end of the tick.

    Returns:
        (middle of its left edge, of its right one, unit vector out from `axis`, whether it lies on
        the axis and has none).
    """
    left = scale(0.5, add(key_point(points, 2 * k, 1), key_point(points, 2 * k + 2, 1)))
    right = scale(0.5, add(key_point(points, 2 * k + 1, 1), key_point(points, 2 * k + 3, 1)))
    out = subtract(scale(0.5, add(left, right)), axis)
    distance = norm(out)
    flat = distance < 1e-6
    return left, right, out if flat else divide(out, distance), flat


@helper
def _contact_column(at, out, columns, grid_layout):  # type: ignore[no-untyped-def]
    """The column whose ground touches a facet there from outside, -1 if none does."""
    x, y = at[0] + _PROBE_DISTANCE * out[0], at[1] + _PROBE_DISTANCE * out[1]
    i = column_index_at(x, y, grid_layout)
    if i < 0 or columns.height[i] <= at[2] + _PROBE_DISTANCE * out[2]:
        return -1
    return i


@helper(inline="always")
def _drum_center(points, pairs, time):  # type: ignore[no-untyped-def]
    """Mean of a drum's key points [m], at the start (0) or the end (1) of the tick."""
    axis = (0.0, 0.0, 0.0)
    for row in range(2 * pairs):
        axis = add(axis, divide(key_point(points, row, time), 2.0 * pairs))
    return axis


@helper(inline="always")
def add_stationary_drum_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add what bears a drum that does not spin; arguments as in `add_milling_force`."""
    pairs = len(points) // 2 - 1
    axis = _drum_center(points, pairs, 1)
    for k in range(pairs):
        left, right, out, flat = _facet(points, k, axis)
        if flat:
            continue
        width = subtract(right, left)
        breadth = norm(subtract(key_point(points, 2 * k + 2, 1), key_point(points, 2 * k, 1)))
        area = breadth * norm(width) / _NUM_STRIPS
        for strip in range(_NUM_STRIPS):
            at = add(left, scale((strip + 0.5) / _NUM_STRIPS, width))
            i = _contact_column(at, out, columns, grid_layout)
            if i < 0:
                continue
            force = area * bearing_capacity(i, breadth, 0.0, columns, strength)
            add_force(sums, subtract(at, origin), scale(-force, out))


@helper(inline="always")
def add_milling_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
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
    axis = _drum_center(points, pairs, 1)
    advance = subtract(axis, _drum_center(points, pairs, 0))
    first = scale(0.5, add(key_point(points, 0, 1), key_point(points, 1, 1)))
    radius = norm(subtract(first, axis))
    for k in range(pairs):
        left, right, out, flat = _facet(points, k, axis)
        if flat:
            continue
        depth = dot(advance, out)
        if depth <= 0.0:
            continue
        corners = key_point(points, 2 * k, 0)
        for row in range(2 * k + 1, 2 * k + 4):
            corners = add(corners, key_point(points, row, 0))
        way = subtract(subtract(scale(0.5, add(left, right)), scale(0.25, corners)), advance)
        spun = norm(way)
        if spun < 1e-6:
            continue
        across = subtract(key_point(points, 2 * k + 2, 1), key_point(points, 2 * k, 1))
        width = subtract(right, left)
        area = norm(across) * norm(width) / _NUM_STRIPS
        for strip in range(_NUM_STRIPS):
            at = add(left, scale((strip + 0.5) / _NUM_STRIPS, width))
            i = _contact_column(at, out, columns, grid_layout)
            if i < 0:
                continue
            energy = _specific_energy(i, at[2], 2.0 * radius, columns, strength)
            against = energy * area * depth / spun
            force = subtract(
                divide(scale(-against, way), spun), scale(_THRUST_RATIO * against, out)
            )
            add_force(sums, subtract(at, origin), force)


@helper(inline="always")
def _specific_energy(i, z, diameter, columns, strength):  # type: ignore[no-untyped-def]
    """Specific energy [J/m^3] of the ground of a column at a height [m]."""
    cover = columns.bulk[i] * columns.metres_per_mm3
    if cover > 0.0 and z > columns.height[i] - cover:  # in loose soil
        kind = columns.loose_soil[i]
        density = columns.loose[i] / columns.bulk[i]
        return strength[kind].gamma * density * diameter
    kind = columns.soil[i]
    if strength[kind].tensile_strength > 0.0:
        return rock_specific_energy(strength[kind].tensile_strength)
    passive = math.tan(math.pi / 4 + 0.5 * strength[kind].phi)
    cohesion = strength[kind].cohesion[columns.moisture[i]]
    return 2.0 * cohesion * passive + strength[kind].gamma * diameter
