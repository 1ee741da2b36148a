"""Resistance to a drum whose picks mill soil or rock: a torque, and a thrust out of the face.

A drum that does not spin removes nothing. The ground bears each of its facets that touch it, in any
direction (`soil_sim.tool_force.bearing_capacity`).

The drum is divided into facets around it and strips along it. A facet whose centre is in the ground
removes, in a tick, the advance of the drum perpendicular to it; the work of its picks is

    W = e * area * advance,

with the *specific energy* e [J/m^3] of the ground. The picks travel the distance w in the tick; the
force against them is W / w, and the thrust out of the face is that force times a ratio.

- **Rock.** A single pick cuts a groove of depth d. Goktan's peak force
  (`soil_sim.tool_force.rock_pick`) over the groove's section d^2 tan(beta) does not depend on d,

      e = m 4 pi sigma_t sin^2(a) / (cos(a) tan(beta)),    a = theta / 2 + psi,

  with the breakout angle beta and the ratio m of the mean to the peak force. For sigma_t = 3 MPa it
  is 8 MJ/m^3 or 2.2 kWh/m^3, within the measured range for a sandstone of 40 MPa at favourable
  spacing (Bilgin, Copur, Balci, Mechanical Excavation in Mining and Civil Industries, 2013, ch. 4).
- **Soil.** It fails passively and is lifted over the drum:
  e = 2 c sqrt(K_p) + gamma D, K_p = tan^2(pi/4 + phi/2).
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper, kernel
from soil_sim.tool_force.bearing_capacity import bearing_capacity
from soil_sim.tool_force.rock_pick import goktan_force
from soil_sim.tool_force.strength_table import column_index_at
from soil_sim.tool_force.wrench import add_force
from soil_sim.vec3 import add, divide, dot, key_point, norm, scale, subtract

__all__ = ["add_milling_force", "add_stationary_drum_force", "is_drum", "rock_specific_energy"]

_NUM_STRIPS = 4
"""Number of strips along the drum."""
_PICK_TIP_ANGLE = math.radians(80.0)
"""Full tip angle of a pick [rad]."""
_PICK_FRICTION = math.radians(10.0)
"""Angle of friction between pick and rock [rad]."""
_BREAKOUT_ANGLE = math.radians(60.0)
"""Breakout angle of a groove, from the normal of the face [rad]."""
_MEAN_TO_PEAK_RATIO = 0.4
"""Ratio of the mean to the peak cutting force of a pick [-]: the force drops as chips break."""
_THRUST_RATIO = 1.0
"""Ratio of the thrust out of the face to the force against the picks [-]."""
_PROBE_DISTANCE = 0.01
"""Distance outside of the pick tips at which contact with the ground is tested [m]."""
_MIN_ROWS = 8
"""Minimum number of key points of a drum."""


@kernel
def rock_specific_energy(tensile_strength):  # type: ignore[no-untyped-def]
    """Return the specific energy [J/m^3] of rock under picks, from its tensile strength [Pa]."""
    return (
        _MEAN_TO_PEAK_RATIO
        * goktan_force(1.0, _PICK_TIP_ANGLE, tensile_strength, _PICK_FRICTION)
        / math.tan(_BREAKOUT_ANGLE)
    )


@helper(inline="always")
def is_drum(points):  # type: ignore[no-untyped-def]
    """Return whether key points, shape (rows, 2, 3), form a closed ring, that of a drum."""
    rows = len(points)
    if rows < _MIN_ROWS:
        return False
    for side in range(2):
        for axis in range(3):
            if abs(points[side, 1, axis] - points[rows - 2 + side, 1, axis]) > 1e-6:
                return False
    return True


@helper
def _facet(points, k, axis):  # type: ignore[no-untyped-def]
    """Return facet `k` of a drum, between two pairs of key points, at the end of the tick.

    Returns:
        (midpoint of its left end, midpoint of its right end, unit vector out from `axis`, whether
        the facet is degenerate: on the axis, without a direction).
    """
    left = scale(0.5, add(key_point(points, 2 * k, 1), key_point(points, 2 * k + 2, 1)))
    right = scale(0.5, add(key_point(points, 2 * k + 1, 1), key_point(points, 2 * k + 3, 1)))
    out = subtract(scale(0.5, add(left, right)), axis)
    distance = norm(out)
    is_degenerate = distance < 1e-6
    return left, right, out if is_degenerate else divide(out, distance), is_degenerate


@helper
def _contact_column(at, out, columns, grid_layout):  # type: ignore[no-untyped-def]
    """Return the index of the column that touches a facet at a point from outside, or -1."""
    x, y = at[0] + _PROBE_DISTANCE * out[0], at[1] + _PROBE_DISTANCE * out[1]
    i = column_index_at(x, y, grid_layout)
    if i < 0 or columns.height[i] <= at[2] + _PROBE_DISTANCE * out[2]:
        return -1
    return i


@helper(inline="always")
def _drum_center(points, pairs, time):  # type: ignore[no-untyped-def]
    """Return the mean of the key points of a drum [m], at the start (0) or end (1) of the tick."""
    axis = (0.0, 0.0, 0.0)
    for row in range(2 * pairs):
        axis = add(axis, divide(key_point(points, row, time), 2.0 * pairs))
    return axis


@helper(inline="always")
def add_stationary_drum_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add the bearing force on a drum that does not spin; arguments as of `add_milling_force`."""
    pairs = len(points) // 2 - 1
    axis = _drum_center(points, pairs, 1)
    for k in range(pairs):
        left, right, out, is_degenerate = _facet(points, k, axis)
        if is_degenerate:
            continue
        width = subtract(right, left)
        facet_width = norm(subtract(key_point(points, 2 * k + 2, 1), key_point(points, 2 * k, 1)))
        area = facet_width * norm(width) / _NUM_STRIPS
        for strip in range(_NUM_STRIPS):
            at = add(left, scale((strip + 0.5) / _NUM_STRIPS, width))
            i = _contact_column(at, out, columns, grid_layout)
            if i < 0:
                continue
            force = area * bearing_capacity(i, facet_width, 0.0, columns, strength)
            add_force(sums, subtract(at, origin), scale(-force, out))


@helper(inline="always")
def add_milling_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add the resistance to the picks of a drum in a tick.

    Args:
        points: start and end of the key points [m], shape (rows, 2, 3), around the drum, left
            before right; the last pair coincides with the first.
        origin: origin of the sums in the map frame [m].
        columns: `ForceColumns` of the terrain.
        grid_layout: `GridLayout` of the terrain.
        strength: `strength_table` of its kinds of soil.
        sums: sums of `add_force`.
    """
    pairs = len(points) // 2 - 1
    axis = _drum_center(points, pairs, 1)
    advance = subtract(axis, _drum_center(points, pairs, 0))
    first = scale(0.5, add(key_point(points, 0, 1), key_point(points, 1, 1)))
    radius = norm(subtract(first, axis))
    for k in range(pairs):
        left, right, out, is_degenerate = _facet(points, k, axis)
        if is_degenerate:
            continue
        depth = dot(advance, out)
        if depth <= 0.0:
            continue
        corners = key_point(points, 2 * k, 0)
        for row in range(2 * k + 1, 2 * k + 4):
            corners = add(corners, key_point(points, row, 0))
        # Motion of the picks relative to the axis, due to the rotation alone.
        pick_motion = subtract(
            subtract(scale(0.5, add(left, right)), scale(0.25, corners)), advance
        )
        pick_distance = norm(pick_motion)
        if pick_distance < 1e-6:
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
            cutting = energy * area * depth / pick_distance
            force = subtract(
                divide(scale(-cutting, pick_motion), pick_distance),
                scale(_THRUST_RATIO * cutting, out),
            )
            add_force(sums, subtract(at, origin), force)


@helper(inline="always")
def _specific_energy(i, z, diameter, columns, strength):  # type: ignore[no-untyped-def]
    """Return the specific energy [J/m^3] of the soil of a column at a height z [m]."""
    loose_depth = columns.bulk[i] * columns.metres_per_mm3
    if loose_depth > 0.0 and z > columns.height[i] - loose_depth:
        kind = columns.loose_soil[i]
        bank_fraction = columns.loose[i] / columns.bulk[i]
        return strength[kind].gamma * bank_fraction * diameter
    kind = columns.soil[i]
    if strength[kind].tensile_strength > 0.0:
        return rock_specific_energy(strength[kind].tensile_strength)
    sqrt_k_p = math.tan(math.pi / 4 + 0.5 * strength[kind].phi)
    cohesion = strength[kind].cohesion[columns.moisture[i]]
    return 2.0 * cohesion * sqrt_k_p + strength[kind].gamma * diameter
