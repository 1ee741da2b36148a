"""Resistance of the ground to the cutting edge of a tool and the plate behind it.

The first pair of key points of a tool is the cutting edge, the second the upper end of the plate
behind it. The motion of the edge in the tick gives the direction of travel t, the width across it
and the rake of the plate. The edge is divided into `NUM_STRIPS` strips. Each is a blade in the soil
ahead of it, so uneven ground, mixed soils and an edge partly in the air need no special rule.

- **Inner face.** The face that cuts is the inner face of the plate, on the side of the rest of the
  tool; a plate without other plates cuts with both faces. n is perpendicular to the travel and the
  edge, and the inner face points along t and n: for a bucket dragged through level ground n is up.
  The force is H against t, V along n.
- **Rake.** That of the chord from the edge to the point at which the plates meet the surface: a
  curved bucket resists as the plane plate that its soil lies against. If the outer face leads
  slightly while the edge is still in front (too small a clearance angle), the rake is the minimum
  rake of the theory. If the edge does not lead, the tool backs out of the cut, and the resistance
  is zero.
- **Surface.** A straight line through the surface ahead, along the wedge that fails, extended to
  the edge (`surface_ahead`): the same for any cell size and direction. Depth and slope are those of
  this line, and the force is that of a wedge below a sloping surface (`failure_wedge`), times a
  factor where the surface is uneven, as before a berm (`uneven_surface`).
- **Steep and rough faces** resist less than a plane wedge gives (`curved_failure`).
- **Inclined travel.** Travel along the slope, or into the surface, turns the blade with it: gravity
  and the surface keep their directions. So the rake to the horizontal is that to the travel less
  the climb angle of the travel. The rest of a climb, out of the surface, does not turn the wedge.
  If the edge dives, the depth counts in full, except where n points down: there it is multiplied by
  1 + n_z, which is zero for n straight down. If it climbs out, the depth is measured perpendicular
  to the travel: for a level edge it is multiplied by the cosine of that angle, which is zero for
  vertical motion.
- **Ends.** At both ends of the edge soil fails in crescents, whose volume is proportional to the
  cube of the depth beside them.
- **Surcharge** is the weight of the soil above the top of the tool, up to the height of the tool.
  Soil *in* the tool is not a surcharge, because its particles press on the tool themselves.
- **Carried soil.** The wedge reaches from the failure plane to the face of the tool. What lies
  between the face and the vertical through the edge is in a bucket already, as particles, whose
  weight the bucket bears. The force of the ground ahead on the bucket and that soil is therefore
  the force on the face, and upward the weight of that soil.
- **Soil** has the kind and moisture of the column ahead. Cohesion counts for the firm part of the
  depth, up to the height of the tool; the unit weight is the mean of firm and loose soil there.
  Soil that the tool pushes ahead heaps up on the column: first the depth increases with it, then
  the surcharge.
- **Rock** is cut by one pick every `_TOOTH_SPACING` at the depth of the strip (Goktan); loose soil
  on it resists as soil does. The interaction of picks deeper than their spacing is neglected, so
  the force is an upper bound there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msg_bridge.kernels import helper
from soil_sim.tool_force.curved_failure import curved_failure_factor
from soil_sim.tool_force.failure_wedge import MIN_RAKE, wedge_force
from soil_sim.tool_force.rock_pick import goktan_force
from soil_sim.tool_force.strength_table import loose_cover, packed_share
from soil_sim.tool_force.surface_ahead import (
    NUM_SAMPLES,
    area_to_face,
    depth_at,
    surface_ahead,
)
from soil_sim.tool_force.uneven_surface import uneven_surface_factor
from soil_sim.tool_force.wrench import add_force
from soil_sim.vec3 import add, cross, divide, dot, key_point, norm, scale, subtract

__all__ = ["MIN_TRAVEL", "NUM_STRIPS", "add_edge_force", "blade_strip_force"]

NUM_STRIPS = 8
"""Number of strips of an edge or a side; even, so that half an edge is a whole number of strips."""

MIN_TRAVEL = 1e-4
"""Minimum travel of an edge in a tick that cuts [m]: float32 positions give no direction below."""

_END_CLEARANCE_CELLS = 1.5
"""Distance from an end of an edge at which the soil beside it is sampled [cells along the grid]: no
column that the edge is in is used."""

_TOOTH_SPACING = 0.25
"""Distance between the teeth of a bucket [m]."""

_PICK_TIP_ANGLE = math.radians(80.0)
"""Full tip angle of a tooth [rad]."""

_PICK_FRICTION = math.radians(10.0)
"""Angle of friction between tooth and rock [rad]."""

_PICK_NORMAL_RATIO = 1.0
"""Ratio of the normal force of a tooth to its cutting force [-]; see `rock_pick`."""


class _Travel(NamedTuple):
    """Motion of a tool in a tick; directions are (x, y, z) in the map frame.

    Attributes:
        direction: unit vector t of the travel.
        normal: unit vector n.
        ahead: horizontal unit vector toward the soil that the edge meets; 0 for vertical travel.
        width: width of the edge across the travel [m].
        rake: rake of the plate [rad], 0 if the outer face leads.
        height: height of the tool above its edge [m].
        carries_soil: whether the inner face leads and has other plates around it, as in a bucket.
        climb: angle of the travel to the horizontal [rad].
        dive_factor: fraction of the depth that resists if the edge dives; 0 if the edge does not
            cut.
    """

    direction: tuple[float, float, float]
    normal: tuple[float, float, float]
    ahead: tuple[float, float]
    width: float
    rake: float
    height: float
    carries_soil: bool
    climb: float
    dive_factor: float


@helper(forceinline=True)
def _travel(points):  # type: ignore[no-untyped-def]
    """Return the travel of a tool from its key points, shape (rows, 2, 3)."""
    none = _Travel((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0), 0.0, 0.0, 0.0, False, 0.0, 0.0)
    left, right = key_point(points, 0, 1), key_point(points, 1, 1)
    edge = scale(0.5, add(left, right))
    displacement = subtract(edge, scale(0.5, add(key_point(points, 0, 0), key_point(points, 1, 0))))
    distance = norm(displacement)
    if distance < MIN_TRAVEL:
        return none
    t = divide(displacement, distance)
    n = cross(t, subtract(right, left))
    width = norm(n)
    if width < 1e-6:
        return none
    n = divide(n, width)
    plate = subtract(scale(0.5, add(key_point(points, 2, 1), key_point(points, 3, 1))), edge)
    plate_behind, plate_beside = -dot(plate, t), dot(plate, n)
    rest = (0.0, 0.0, 0.0)
    top = edge[2]
    for row in range(len(points)):
        rest = add(rest, subtract(key_point(points, row, 1), edge))
        top = max(top, points[row, 1, 2])
    # (plate_beside, plate_behind) is the normal of the inner face in t and n. Flip n if it points
    # away from the rest of the tool.
    inside = dot(rest, t) * plate_beside + dot(rest, n) * plate_behind
    is_single_plate = abs(inside) <= 1e-6 * len(points)
    if plate_beside < 0.0 if is_single_plate else inside < 0.0:
        n, plate_beside = scale(-1.0, n), -plate_beside
    if plate_beside <= 0.0 and plate_behind <= 0.0:
        return none
    climb = math.asin(min(max(t[2], -1.0), 1.0))
    dive_factor = min(1.0, 1.0 + n[2])
    dive = max(-t[2], 0.0)
    ax, ay = t[0] + dive * n[0], t[1] + dive * n[1]
    ahead = math.hypot(ax, ay)
    if ahead > 1e-6:
        ax, ay = ax / ahead, ay / ahead
    rake = math.atan2(max(plate_beside, 0.0), plate_behind)
    carries_soil = not is_single_plate and plate_beside > 0.0
    return _Travel(t, n, (ax, ay), width, rake, top - edge[2], carries_soil, climb, dive_factor)


@helper(allocates=True, forceinline=True)
def add_edge_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add the resistance to the cutting edge of a tool in a tick.

    Args:
        points: start and end of the key points [m], shape (rows, 2, 3), cutting edge first.
        origin: origin of the sums in the map frame [m].
        columns: `ForceColumns` of the terrain.
        grid_layout: `GridLayout` of the terrain.
        strength: `strength_table` of its kinds of soil.
        sums: sums of `add_force`.
    """
    travel = _travel(points)
    if travel.dive_factor <= 0.0:
        return
    left, right = key_point(points, 0, 1), key_point(points, 1, 1)
    across = subtract(right, left)
    t, n = travel.direction, travel.normal
    samples = np.empty(NUM_SAMPLES)
    ends = (
        _end_fraction(left, scale(-1.0, across), travel, columns, grid_layout, samples),
        _end_fraction(right, across, travel, columns, grid_layout, samples),
    )
    ends_per_width = (ends[0] + ends[1]) / travel.width
    for strip in range(NUM_STRIPS):
        at = add(left, scale((strip + 0.5) / NUM_STRIPS, across))
        surface = surface_ahead(
            at[0], at[1], at[2], travel.ahead, travel.height, columns, grid_layout, samples
        )
        below = surface.depth
        if surface.column < 0 or below <= 0.0:
            continue
        turn, factor = _turn_and_depth_factor(travel, surface.slope)
        width, depth = travel.width / NUM_STRIPS, factor * below
        if depth <= 0.0:
            continue
        num_ends = ends[0] if strip == 0 else ends[1] if strip == NUM_STRIPS - 1 else 0.0
        rake = _rake_below(points, travel, max(below, surface.at_edge))
        cutting, normal, gamma = blade_strip_force(
            surface, samples, travel.height, depth, width, (num_ends, ends_per_width), rake, turn,
            columns, strength,
        )  # fmt: skip
        fx, fy, fz = subtract(scale(normal, n), scale(cutting, t))
        if travel.carries_soil:
            # Of the depth that resists, as the force.
            area = area_to_face(surface.at_edge, surface.near_tangent, max(rake - turn, MIN_RAKE))
            fz += gamma * width * max(area, 0.0) * (depth / below) ** 2
        x, y, z = subtract(at, origin)
        add_force(sums, (x, y, z + depth / 3.0), (fx, fy, fz))


@helper
def _rake_below(points, travel, depth):  # type: ignore[no-untyped-def]
    """Return the rake of the plates below a surface [rad]: of the chord from the edge to it.

    It ends where the plates do not rise further. If its outer face leads, the rake is that of the
    first plate.

    Args:
        points: start and end of the key points [m], shape (rows, 2, 3).
        travel: `_Travel` of the tool.
        depth: height of the surface above the edge [m].
    """
    edge = scale(0.5, add(key_point(points, 0, 1), key_point(points, 1, 1)))
    top = edge
    for row in range(2, len(points) - 1, 2):
        upper = scale(0.5, add(key_point(points, row, 1), key_point(points, row + 1, 1)))
        if upper[2] <= top[2]:
            break
        excess = upper[2] - edge[2] - depth
        if excess >= 0.0:
            top = subtract(upper, scale(excess / (upper[2] - top[2]), subtract(upper, top)))
            break
        top = upper
    chord = subtract(top, edge)
    behind, beside = -dot(chord, travel.direction), dot(chord, travel.normal)
    return math.atan2(beside, behind) if beside > 0.0 else travel.rake


@helper(forceinline=True)
def _turn_and_depth_factor(travel, slope):  # type: ignore[no-untyped-def]
    """Return the angle by which the travel turns the blade, and the depth that resists.

    The failure wedge depends on the angle of the blade to the surface, not to the travel: along a
    slope, and where the edge dives, this is the rake less the angle of the travel. Where the edge
    climbs out, less soil resists instead.

    Args:
        travel: `_Travel` of the tool.
        slope: slope of the surface ahead [rad].

    Returns:
        (angle [rad], fraction of the depth).
    """
    turn = min(max(travel.climb, min(slope, 0.0)), max(slope, 0.0))
    rest = travel.climb - turn
    if rest < 0.0:
        return travel.climb, travel.dive_factor
    cos = math.cos(travel.climb)
    if cos < 1e-6:
        return turn, 0.0
    return turn, max(travel.normal[2], 0.0) / cos * math.cos(rest)


@helper(forceinline=True)
def _end_fraction(end, outward, travel, columns, grid_layout, samples):  # type: ignore[no-untyped-def]
    """Return the fraction of a crescent that fails beside an end of an edge.

    Args:
        end: the end [m].
        outward: vector along the edge, out of that end; any length.
        travel, columns, grid_layout: as for `add_edge_force`.
        samples: out, see `surface_ahead`.
    """
    length = math.hypot(outward[0], outward[1])
    surface = surface_ahead(
        end[0], end[1], end[2], travel.ahead, travel.height, columns, grid_layout, samples
    )
    depth = surface.depth
    if length < 1e-6 or surface.column < 0 or depth <= 0.0:
        return 0.0
    ox, oy = outward[0] / length, outward[1] / length
    aside = _END_CLEARANCE_CELLS * grid_layout.cell * (abs(ox) + abs(oy))
    beside = depth_at(end[0] + aside * ox, end[1] + aside * oy, end[2], columns, grid_layout)
    fraction = min(max(beside / depth, 0.0), 1.0)
    return fraction * fraction * fraction


@helper
def blade_strip_force(  # type: ignore[no-untyped-def]
    surface, samples, height, depth, width, ends, rake, turn, columns, strength
):
    """Return the forces on a strip of a blade, and the unit weight of the soil that it cuts.

    Args:
        surface: `SurfaceAhead` of the strip.
        samples: heights of that surface, as written by `surface_ahead`; its first column on.
        height: height of the strip [m].
        depth: part of that depth that resists [m].
        width: width of the strip [m].
        ends: number of ends of the blade in the strip beside which soil fails, and that of the
            whole blade over its width [1/m].
        rake: rake of the strip to the travel [rad].
        turn: angle by which the travel turns the blade [rad]; see `_turn_and_depth_factor`.
        columns: `ForceColumns` of the terrain.
        strength: `strength_table` of its kinds of soil.

    Returns:
        (force against the travel [N], force perpendicular to it [N], unit weight of the soil in the
        failure wedge, 0 in rock [N/m^3]).
    """
    i, below, above = surface.column, surface.depth, min(surface.cover, height)
    # The loose soil is on top: that above the tool is a surcharge, and no part of the cut.
    firm_depth = max(below + above - loose_cover(columns, i), 0.0)
    firm_fraction = min(firm_depth / below, 1.0)
    kind = columns.soil[i] if firm_fraction > 0.0 else columns.loose_soil[i]
    gamma = surcharge = 0.0
    if columns.loose[i] > 0:
        gamma = strength[columns.loose_soil[i]].gamma * (columns.loose[i] / columns.bulk[i])
    if above > 0.0:
        firm_above = min(max(firm_depth - below, 0.0), above)
        surcharge = strength[columns.soil[i]].gamma * firm_above + gamma * (above - firm_above)
    cutting = normal = wedge_gamma = 0.0
    if firm_fraction > 0.0 and strength[kind].tensile_strength > 0.0:  # rock
        num_picks = width / _TOOTH_SPACING
        cutting = num_picks * goktan_force(
            firm_fraction * depth, _PICK_TIP_ANGLE, strength[kind].tensile_strength, _PICK_FRICTION
        )
        normal = _PICK_NORMAL_RATIO * cutting
        depth *= 1.0 - firm_fraction
        cohesion = adhesion = surcharge = 0.0
    else:
        firm_in_cut = min(firm_depth, below)
        packed = packed_share(columns, i, firm_depth - firm_in_cut, firm_in_cut)
        shrinkage = columns.shrinkage[kind]
        firm_gamma = strength[kind].gamma * (1.0 + packed * shrinkage / (1.0 - shrinkage))
        gamma = wedge_gamma = firm_fraction * firm_gamma + (1.0 - firm_fraction) * gamma
        cohesion = firm_fraction * strength[kind].cohesion[columns.moisture[i]]
        cohesion *= 1.0 + packed * (strength[kind].packed_strength - 1.0)
        adhesion = strength[kind].adhesion[columns.moisture[i]]
    horizontal, vertical = wedge_force(
        width, ends[0], ends[1], depth, rake - turn, surface.slope, surcharge, gamma,
        strength[kind].phi, strength[kind].delta, cohesion, adhesion,
    )  # fmt: skip
    factor = curved_failure_factor(
        rake - turn + min(surface.slope, 0.0), strength[kind].phi, strength[kind].delta
    )
    if gamma > 0.0:
        factor *= uneven_surface_factor(
            surface, samples, rake - turn, strength[kind].phi, strength[kind].delta,
            cohesion / gamma, ends[1],
        )  # fmt: skip
    horizontal, vertical = factor * horizontal, factor * vertical
    # From the frame of the wedge to that of the travel.
    cos, sin = math.cos(turn), math.sin(turn)
    return (
        cutting + horizontal * cos - vertical * sin,
        normal + horizontal * sin + vertical * cos,
        wedge_gamma,
    )
