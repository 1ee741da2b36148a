"""What resists the lip of a tool and the plate behind it, the cut itself.

A tool is a lip and the cutting plate behind it: its first pair of key points and its second. From
where the lip went in the tick come the direction of travel t, the width across it, and the rake of
the plate against it. The lip is cut into `NUM_STRIPS` strips, each a blade of its own in the soil that
stands before it, so that uneven ground, mixed soil and a lip that is half in the air need no rule.

- **Inside.** Soil is cut by the inside of a plate, the side on which the rest of the tool lies; a
  plate with nothing beside it cuts with both. n is square to the travel and the lip, such that the
  inside looks along t and n: for a bucket dragged through level ground it is up. The force is
  H against t, V along n.
- **Rake.** Where the outside leads a little and the lip is still in front (too small a clearance)
  it counts as the least rake of the theory. Where the lip does not lead, the tool backs out of the
  cut, and nothing resists.
- **Depth** is that of the lip below the surface `LOOKAHEAD_CELLS` cells ahead, where nothing is cut yet. It
  counts in full for a lip that moves level or dives; one that rises meets the wedge to the surface
  square to its way, depth times cos of the climb, and none straight up.
- **Surcharge** is the weight of what stands above the top of the tool, up to once its height: a
  blade at the foot of a wall does not push the wall. What lies *in* the tool is no surcharge, its
  particles press on the tool themselves.
- **Soil** is of the kind and moisture found there, cohesion counts for the firm part of the depth,
  the weight is that of firm and loose soil as they lie.
- **Rock** is cut by one pick every `_TOOTH_SPACING`, as deep as the strip (Goktan); loose soil on
  it counts as a blade in that. Picks further in than they are apart help one another, which is
  left out: there it is an upper bound.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from msg_bridge.kernels import helper
from soil_sim.tool_force.earthmoving_equation import blade_force
from soil_sim.tool_force.rock_pick import goktan_force
from soil_sim.tool_force.strength_table import add_force, column_index_at
from soil_sim.vec3 import add, cross, divide, dot, key_point, norm, scale, subtract

__all__ = ["LOOKAHEAD_CELLS", "MIN_TRAVEL", "NUM_STRIPS", "add_edge_force", "blade_strip_force"]

NUM_STRIPS = 8
"""Strips of a lip or a side; even, so that a lip half in the ground is four of them."""

LOOKAHEAD_CELLS = 1.5
"""Where the depth is measured before lip or side, in cells: the next column in any direction."""

MIN_TRAVEL = 1e-4
"""A lip that moves less than this in a tick [m] cuts nothing: float32 has no direction for it."""

_TOOTH_SPACING = 0.25
"""From tooth to tooth of a bucket [m]."""

_PICK_TIP_ANGLE = math.radians(80.0)
"""Full angle of a tooth's tip."""

_PICK_FRICTION = math.radians(10.0)
"""Angle of friction between tooth and rock."""

_PICK_NORMAL_RATIO = 1.0
"""Force out of the rock over the force against the travel; see `soil_sim.tool_force.rock_pick`."""


class _Travel(NamedTuple):
    """How a tool moves in its tick, for kernels; directions are (x, y, z) of the map.

    Attributes:
        along, off: t and n, unit vectors.
        ahead: horizontal unit vector to where the soil is that the lip meets; 0 without one.
        width: of the lip across the travel [m].
        rake: of the plate against the travel [rad], 0 where the outside leads.
        height: of the tool above its lip [m].
        counts: part of the depth that resists.
    """

    direction: tuple[float, float, float]
    normal: tuple[float, float, float]
    ahead: tuple[float, float]
    width: float
    rake: float
    height: float
    depth_factor: float


@helper(inline="always")
def _travel(points):  # type: ignore[no-untyped-def]
    """The travel of one tool by its key points, shape (rows, 2, 3)."""
    none = _Travel((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0), 0.0, 0.0, 0.0, 0.0)
    left, right = key_point(points, 0, 1), key_point(points, 1, 1)
    lip = scale(0.5, add(left, right))
    way = subtract(lip, scale(0.5, add(key_point(points, 0, 0), key_point(points, 1, 0))))
    far = norm(way)
    if far < MIN_TRAVEL:
        return none
    t = divide(way, far)
    n = cross(t, subtract(right, left))
    width = norm(n)
    if width < 1e-6:
        return none
    n = divide(n, width)
    plate = subtract(scale(0.5, add(key_point(points, 2, 1), key_point(points, 3, 1))), lip)
    behind, beside = -dot(plate, t), dot(plate, n)
    rest = (0.0, 0.0, 0.0)
    top = lip[2]
    for row in range(len(points)):
        rest = add(rest, subtract(key_point(points, row, 1), lip))
        top = max(top, points[row, 1, 2])
    # The inside's normal is (beside, behind) in t and n; n is turned until the rest is there.
    inside = dot(rest, t) * beside + dot(rest, n) * behind
    alone = abs(inside) <= 1e-6 * len(points)
    if beside < 0.0 if alone else inside < 0.0:
        n, beside = scale(-1.0, n), -beside
    if beside <= 0.0 and behind <= 0.0:
        return none
    depth_factor = min(1.0, 1.0 + n[2]) if t[2] < 0.0 else max(n[2], 0.0)
    dive = max(-t[2], 0.0)
    ax, ay = t[0] + dive * n[0], t[1] + dive * n[1]
    ahead = math.hypot(ax, ay)
    if ahead > 1e-6:
        ax, ay = ax / ahead, ay / ahead
    rake = math.atan2(max(beside, 0.0), behind)
    return _Travel(t, n, (ax, ay), width, rake, top - lip[2], depth_factor)


@helper(inline="always")
def add_edge_force(points, origin, columns, grid_layout, strength, sums):  # type: ignore[no-untyped-def]
    """Add what resists the cut of a tool's lip in a tick; places from `middle`.

    Args:
        points: start and end of its key points [m], shape (rows, 2, 3), lip first.
        middle: where places count from [m].
        columns, frame: of the terrain.
        strength: of its soils.
        sums: of `add_force`.
    """
    travel = _travel(points)
    if travel.depth_factor <= 0.0:
        return
    left, right = key_point(points, 0, 1), key_point(points, 1, 1)
    t, n = travel.direction, travel.normal
    ahead = LOOKAHEAD_CELLS * grid_layout[2]
    for strip in range(NUM_STRIPS):
        at = add(left, scale((strip + 0.5) / NUM_STRIPS, subtract(right, left)))
        i = column_index_at(
            at[0] + ahead * travel.ahead[0], at[1] + ahead * travel.ahead[1], grid_layout
        )
        if i < 0 or columns.height[i] <= at[2]:
            continue
        below = columns.height[i] - at[2]
        width, depth = travel.width / NUM_STRIPS, travel.depth_factor * min(below, travel.height)
        against, off = blade_strip_force(
            i, below, depth, width, travel.rake, travel.height, columns, strength
        )
        x, y, z = subtract(at, origin)
        add_force(sums, (x, y, z + depth / 3.0), subtract(scale(off, n), scale(against, t)))


@helper
def blade_strip_force(  # type: ignore[no-untyped-def]
    i, below, depth, width, rake, height, columns, strength
):
    """Forces [N] against the travel and square to it on a strip of a blade.

    Args:
        i: flat index of the column before it.
        below: how far its lower edge is below that column's surface [m].
        depth: what of that resists [m].
        width, rake, height: of the strip [m], [rad], [m].
        columns: of the terrain.
        strength: of its soils.
    """
    above = min(max(below - height, 0.0), height)
    cover = columns.bulk[i] * columns.metres_per_mm3
    firm = max(0.0, 1.0 - cover / below)  # part of the depth
    kind = columns.soil[i] if firm > 0.0 else columns.loose_soil[i]
    gamma = 0.0
    if firm < 1.0:
        gamma = strength[columns.loose_soil[i]].gamma * (columns.loose[i] / columns.bulk[i])
    rock = firm > 0.0 and strength[kind].tensile_strength > 0.0
    against = off = 0.0
    if rock:
        picks = width / _TOOTH_SPACING
        against = picks * goktan_force(
            firm * depth, _PICK_TIP_ANGLE, strength[kind].tensile_strength, _PICK_FRICTION
        )
        off = _PICK_NORMAL_RATIO * against
        depth *= 1.0 - firm
        cohesion = adhesion = above = 0.0
    else:
        gamma = firm * strength[kind].gamma + (1.0 - firm) * gamma
        cohesion = firm * strength[kind].cohesion[columns.moisture[i]]
        adhesion = strength[kind].adhesion[columns.moisture[i]]
    horizontal, vertical = blade_force(
        width, depth, rake, gamma * above, gamma, strength[kind].phi, strength[kind].delta,
        cohesion, adhesion,
    )  # fmt: skip
    return against + horizontal, off + vertical
