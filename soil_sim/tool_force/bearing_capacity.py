"""Bearing force of the soil under the plates and the cutting edge of a tool, by bearing capacity.

Soil bears a tool in contact with it, whether the tool moves or not. Each plate whose outer face
points downward and touches soil carries the bearing capacity of a strip footing, along the normal
of the plate; the cutting edge, a strip as wide as the edge is thick, carries it along its plate::

    q = c N_c + q_0 N_q + gamma B N_gamma / 2,    N_q = exp(pi tan phi) tan^2(pi / 4 + phi / 2),
    N_c = (N_q - 1) cot phi,                      N_gamma = 2 (N_q + 1) tan phi

(Vesic, Analysis of ultimate loads of shallow foundations, J. Soil Mech. Found. Div. ASCE 99, SM1,
1973). B is the width of the footing, q_0 the overburden beside it, on the lower side, to which the
soil would yield. The floor of the terrain bears like rock, upward.

Soil takes the shape of the tool that sinks into it, so that its plates find support. Rock does not:
a tool stands on rock with what is lowest, often the edge between two plates or at the end of the
last one. In rock, these edges and the middle line of each plate are therefore strips like the
cutting edge. Rock bears upward, as it does not yield sideways either, and in proportion to the
penetration (Winkler's foundation), so that the support is where the tool would sink deepest.

The force is published in every tick as the maximum that the soil carries; the machine applies the
part that balances its load.
"""

from __future__ import annotations

import math

import numpy as np

from msg_bridge.kernels import helper
from soil_sim.tool_force.strength_table import column_index_at, loose_cover, packed_share
from soil_sim.tool_force.wrench import add_force
from soil_sim.vec3 import add, cross, divide, dot, key_point, norm, scale, subtract

__all__ = ["add_bearing_force", "bearing_capacity"]

_NUM_STRIPS = 8
"""Strips of a plate, and of the cutting edge."""

_MIN_DOWNWARD_NORMAL = 0.3
"""Minimum downward component (-z) of the outward normal of a face that soil can bear."""

_CONTACT_GAP = 0.01
"""Maximum gap between a plate and the soil it touches [m]; the height of a column is a mean over
the cut surface."""

_EDGE_THICKNESS = 0.04
"""Thickness of the cutting edge [m]."""

_FLOOR_CAPACITY = 10e6
"""Bearing capacity of the floor of the terrain [Pa]: typical of sound rock, more than machines
push."""

_SURCHARGE_DISTANCE_CELLS = 1.5
"""Distance from the edge at which the height of the overburden is sampled [cells]."""

_UP = (0.0, 0.0, 1.0)
"""Direction of the force of the floor, which is level and does not yield sideways."""

_PAD_POINT, _PAD_NORMAL, _PAD_AREA, _PAD_IS_FLOOR, _PAD_SIZE = 0, 3, 6, 7, 8
"""Slots of a pad, a strip of a plate in contact: its centre relative to the origin [m] (3), the
direction of the bearing force (3), its area [m^2], whether it is at the floor of the terrain."""


@helper(allocates=True, forceinline=True)
def add_bearing_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add the maximum bearing force on a tool at the end of its tick.

    Args:
        points: start and end of the key points [m], shape (rows, 2, 3), cutting edge first.
        origin: origin of the sums in the map frame [m].
        columns: `ForceColumns` of the terrain.
        grid_layout: `GridLayout` of the terrain.
        strength: `strength_table` of its kinds of soil.
        sums: sums of `add_force`.
    """
    num_plates = len(points) // 2 - 1
    center = (0.0, 0.0, 0.0)
    for row in range(len(points)):
        center = add(center, divide(key_point(points, row, 1), float(len(points))))
    pad_column = np.empty(num_plates * _NUM_STRIPS, dtype=np.int64)
    pads = np.empty((num_plates * _NUM_STRIPS, _PAD_SIZE))
    count = 0
    for k in range(num_plates):
        a, b = key_point(points, 2 * k, 1), key_point(points, 2 * k + 1, 1)
        c, d = key_point(points, 2 * k + 2, 1), key_point(points, 2 * k + 3, 1)
        out = cross(subtract(b, a), scale(0.5, subtract(subtract(add(c, d), a), b)))
        area = norm(out)
        if area < 1e-9:
            continue
        out = divide(out, area)
        inward = dot(out, subtract(center, a))
        if inward > 0.0:
            out = scale(-1.0, out)
        # A single plate has no outer face; an upright plate does not rest on soil.
        if abs(inward) < 1e-6 or out[2] > -_MIN_DOWNWARD_NORMAL:
            continue
        for strip in range(_NUM_STRIPS):
            fraction = (strip + 0.5) / _NUM_STRIPS
            at = scale(0.5, add(scale(1.0 - fraction, add(a, c)), scale(fraction, add(b, d))))
            i = column_index_at(at[0], at[1], grid_layout)
            if i < 0 or _stands_on_rock(i, at[2], columns, strength):
                continue
            # Compare the plate above the centre of the column with the height of the column, which
            # is that of the end of the last tick.
            row, col = i // grid_layout.cols, i % grid_layout.cols
            dx = grid_layout.x_first - row * grid_layout.cell - at[0]
            dy = grid_layout.y_first - col * grid_layout.cell - at[1]
            if columns.height[i] + _CONTACT_GAP > at[2] - (out[0] * dx + out[1] * dy) / out[2]:
                pad_column[count] = i
                is_floor = at[2] <= columns.floor + _CONTACT_GAP
                normal = _UP if is_floor else scale(-1.0, out)
                for axis in range(3):
                    pads[count, _PAD_POINT + axis] = at[axis] - origin[axis]
                    pads[count, _PAD_NORMAL + axis] = normal[axis]
                pads[count, _PAD_AREA] = area / _NUM_STRIPS
                pads[count, _PAD_IS_FLOOR] = is_floor
                count += 1
    if count:
        footing_width = 0.0
        for n in range(count):
            footing_width += pads[n, _PAD_AREA]
        footing_width /= norm(subtract(key_point(points, 1, 1), key_point(points, 0, 1)))
        for n in range(count):
            x, y, z, nx, ny, nz, area, is_floor = pads[n]
            capacity = _FLOOR_CAPACITY
            if not is_floor:
                capacity = bearing_capacity(pad_column[n], footing_width, 0.0, columns, strength)
            add_force(sums, (x, y, z), scale(area * capacity, (nx, ny, nz)))
    _add_edge_bearing(points, origin, columns, grid_layout, strength, sums)
    _add_rock_bearing(points, origin, columns, grid_layout, strength, sums)


@helper(forceinline=True)
def _add_edge_bearing(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add the maximum bearing force on the cutting edge, along its plate."""
    left, right = key_point(points, 0, 1), key_point(points, 1, 1)
    above = add(key_point(points, 2, 1), key_point(points, 3, 1))
    up = scale(0.5, subtract(subtract(above, left), right))
    length = norm(up)
    if length < 1e-6 or up[2] < _MIN_DOWNWARD_NORMAL * length:
        return
    up = divide(up, length)
    across = subtract(right, left)
    width = norm(across)
    horizontal = math.hypot(across[0], across[1])
    if horizontal < 1e-6:
        return
    # Horizontal offset, perpendicular to the edge, to the soil on one side of it.
    side_x, side_y = (
        -across[1] / horizontal * _SURCHARGE_DISTANCE_CELLS * grid_layout.cell,
        across[0] / horizontal * _SURCHARGE_DISTANCE_CELLS * grid_layout.cell,
    )
    for strip in range(_NUM_STRIPS):
        at = add(left, scale((strip + 0.5) / _NUM_STRIPS, across))
        i = column_index_at(at[0], at[1], grid_layout)
        if i < 0 or columns.height[i] + _CONTACT_GAP <= at[2]:
            continue
        if _stands_on_rock(i, at[2], columns, strength):
            continue
        surcharge_depth = math.inf
        for sign in (-1.0, 1.0):
            j = column_index_at(at[0] + sign * side_x, at[1] + sign * side_y, grid_layout)
            if j >= 0:
                surcharge_depth = min(surcharge_depth, columns.height[j] - at[2])
        surcharge_depth = max(surcharge_depth, 0.0) if surcharge_depth < math.inf else 0.0
        area = _EDGE_THICKNESS * width / _NUM_STRIPS
        arm = subtract(at, origin)
        if at[2] <= columns.floor + _CONTACT_GAP:
            add_force(sums, arm, scale(area * _FLOOR_CAPACITY, _UP))
            continue
        capacity = bearing_capacity(i, _EDGE_THICKNESS, surcharge_depth, columns, strength)
        add_force(sums, arm, scale(area * capacity, up))


@helper(inline="always")
def _add_rock_bearing(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add the maximum bearing force of rock on the edges and the middle lines of the plates."""
    has_rock = False
    for kind in range(len(strength)):
        has_rock |= strength[kind].tensile_strength > 0.0
    if not has_rock:
        return
    num_lines = len(points) - 1
    depths = np.zeros((num_lines, _NUM_STRIPS))
    deepest = 0.0
    for line in range(num_lines):
        for strip in range(_NUM_STRIPS):
            at = _point_on_line(points, line, strip)
            i = column_index_at(at[0], at[1], grid_layout)
            if i >= 0:
                depths[line, strip] = _rock_depth(i, at[2], columns, strength)
                deepest = max(deepest, depths[line, strip])
    if deepest <= 0.0:
        return
    width = norm(subtract(key_point(points, 1, 1), key_point(points, 0, 1)))
    area = _EDGE_THICKNESS * width / _NUM_STRIPS
    for line in range(num_lines):
        for strip in range(_NUM_STRIPS):
            if depths[line, strip] > 0.0:
                at = _point_on_line(points, line, strip)
                i = column_index_at(at[0], at[1], grid_layout)
                force = area * bearing_capacity(i, _EDGE_THICKNESS, 0.0, columns, strength)
                force *= depths[line, strip] / deepest
                add_force(sums, subtract(at, origin), scale(force, _UP))


@helper
def _point_on_line(points, line, strip):  # type: ignore[no-untyped-def]
    """Return the middle of a strip [m] of an edge (even line) or the middle line of a plate."""
    first, second = line // 2, (line + 1) // 2
    left = add(key_point(points, 2 * first, 1), key_point(points, 2 * second, 1))
    right = add(key_point(points, 2 * first + 1, 1), key_point(points, 2 * second + 1, 1))
    fraction = (strip + 0.5) / _NUM_STRIPS
    return scale(0.5, add(scale(1.0 - fraction, left), scale(fraction, right)))


@helper
def _stands_on_rock(i, z, columns, strength):  # type: ignore[no-untyped-def]
    """Return whether what column i bears at a height z [m] is the rock in it, not soil on rock."""
    if strength[columns.soil[i]].tensile_strength <= 0.0:
        return False
    return columns.loose[i] == 0 or _rock_depth(i, z, columns, strength) > 0.0


@helper
def _rock_depth(i, z, columns, strength):  # type: ignore[no-untyped-def]
    """Return the depth of a height below the rock of column i, plus the contact gap [m].

    It is not positive where no rock is touched.
    """
    if strength[columns.soil[i]].tensile_strength <= 0.0:
        return 0.0
    return columns.height[i] - loose_cover(columns, i) + _CONTACT_GAP - z


@helper
def bearing_capacity(i, footing_width, surcharge_depth, columns, strength):  # type: ignore[no-untyped-def]
    """Return the bearing capacity of a column [Pa].

    Only the firm part of the soil within one footing width below the footing has cohesion.

    Args:
        i: flat index of the column.
        footing_width: width of the footing [m].
        surcharge_depth: depth of the footing below the soil beside it [m].
        columns: `ForceColumns` of the terrain.
        strength: `strength_table` of its kinds of soil.
    """
    firm_fraction = max(0.0, 1.0 - loose_cover(columns, i) / footing_width)
    kind = columns.soil[i] if firm_fraction > 0.0 else columns.loose_soil[i]
    packed = packed_share(columns, i, 0.0, firm_fraction * footing_width)
    cohesion = firm_fraction * strength[kind].cohesion[columns.moisture[i]]
    cohesion *= 1.0 + packed * (strength[kind].packed_strength - 1.0)
    gamma = strength[kind].gamma
    capacity = cohesion * strength[kind].n_c + gamma * surcharge_depth * strength[kind].n_q
    return capacity + 0.5 * footing_width * gamma * strength[kind].n_gamma
