"""What the soil does to the tools that sweep it: the sweeps of a tick, turned into wrenches.

A tool is a lip and the cutting plate behind it: its first pair of key points and its second. From
where the lip went in the tick come the direction of travel t, the width across it, and the rake of
the plate against it. The lip is cut into `_STRIPS` strips, each a blade of its own in the soil
that stands before it (`soil_sim.force`), so that uneven ground, mixed soil and a lip that is half
in the air need no rule. The strips' forces add up to a force and a torque about one point.

- **Side.** Soil is cut by the inside of a plate, the side on which the rest of the tool lies; a
  plate with nothing beside it cuts with both. n is square to the travel and the lip, such that the
  inside looks along t and n: for a bucket dragged through level ground it is up. The force is
  H against t, V along n.
- **Rake.** Where the outside leads a little and the lip is still in front (too small a clearance)
  it counts as the least rake of the theory. Where the lip does not lead, the tool backs out of the
  cut, and nothing resists.
- **Depth** is that of the lip below the surface `_AHEAD` cells ahead, where nothing is cut yet. It
  counts in full for a lip that moves level or dives; one that rises meets the wedge to the surface
  square to its way, depth times cos of the climb, and none straight up.
- **Surcharge** is the weight of what stands above the top of the tool, up to once its height: a
  blade at the foot of a wall does not push the wall. What lies *in* the tool is no surcharge, its
  particles press on the tool themselves.
- **Soil** is of the kind and moisture found there, cohesion counts for the firm part of the depth,
  the weight is that of firm and loose soil as they lie.
- **Rock** is cut by one pick every `_PICK_SPACING`, as deep as the strip (Goktan); loose soil on
  it counts as a blade in that. Picks further in than they are apart help one another, which is
  left out: there it is an upper bound.

Soil under a tool bears it. Where the outside of a plate goes against soil, it presses on the area
it shows to the travel, with the bearing capacity of a strip footing on the surface,

    q = c N_c + gamma B N_gamma / 2,    N_q = exp(pi tan phi) tan^2(pi / 4 + phi / 2),
    N_c = (N_q - 1) cot phi,    N_gamma = 2 (N_q + 1) tan phi

(Vesic, Analysis of ultimate loads of shallow foundations, J. Soil Mech. Found. Div. ASCE 99, SM1,
1973), B the breadth pressed on; it acts against the travel. This is what a machine leans on when
the cut lifts its tracks.

Sideways, along its lip, a tool cuts no width and feels nothing: its side plates are left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from msg_bridge.contract.rows import FORCE, Action, Rows, empty_rows
from soil_sim.columns import Columns
from soil_sim.force import blade_force, goktan_force
from soil_sim.soils import MOIST, SoilType
from soil_sim.sweeps import first_of_tools

__all__ = ["Resistance", "no_resistance"]

_GRAVITY = 9.81

_STRIPS = 8
"""Strips of the lip; even, so that a lip half in the ground is four of them."""

_AHEAD = 1.5
"""Where the depth is measured before the lip, in cells: the next column, whatever the direction."""

_AT_REST = 1e-4
"""A lip that moves less than this in a tick [m] cuts nothing: float32 has no direction for it."""

_UPRIGHT = 0.3
"""A plate whose outside looks down less than this (-z of its normal) does not press."""

_PICK_SPACING = 0.25
"""From tooth to tooth of a bucket [m]."""

_PICK_ANGLE = math.radians(80.0)
"""Full angle of a tooth's tip."""

_PICK_FRICTION = math.radians(10.0)
"""Angle of friction between tooth and rock."""

_PICK_NORMAL = 1.0
"""Force out of the rock over the force against the travel; see `soil_sim.force.pick`."""


class Strength(NamedTuple):
    """What kernels need of the kinds of soil, by id, and by id and moisture [%].

    Attributes:
        gamma: unit weight of firm soil [N/m³], shape (kinds,).
        phi, delta: internal and tool friction [rad], shape (kinds,).
        tensile: of rock [Pa], 0 for soil, shape (kinds,).
        n_c, n_gamma: factors of bearing capacity [-], shape (kinds,).
        cohesion, adhesion: [Pa], shape (kinds, MOIST).
    """

    gamma: NDArray[np.float64]
    phi: NDArray[np.float64]
    delta: NDArray[np.float64]
    tensile: NDArray[np.float64]
    n_c: NDArray[np.float64]
    n_gamma: NDArray[np.float64]
    cohesion: NDArray[np.float64]
    adhesion: NDArray[np.float64]

    @classmethod
    def of(cls, kinds: Sequence[SoilType]) -> Strength:
        """Tables of some kinds of soil, whose ids are their places in the sequence."""
        stick = np.array([[kind.stick(m) for m in range(MOIST)] for kind in kinds])
        phi = np.array([math.radians(kind.internal_friction) for kind in kinds])
        tan = np.tan(np.maximum(phi, 1e-6))  # without friction N_c tends to 2 + pi
        n_q = np.exp(math.pi * tan) * np.tan(math.pi / 4 + np.arctan(tan) / 2) ** 2
        return cls(
            np.array([kind.density * _GRAVITY for kind in kinds]),
            phi,
            np.array([math.radians(kind.tool_friction) for kind in kinds]),
            np.array([kind.tensile_strength for kind in kinds]),
            (n_q - 1.0) / tan,
            2.0 * (n_q + 1.0) * tan,
            np.array([[kind.cohesion] for kind in kinds]) * stick,
            np.array([[kind.adhesion] for kind in kinds]) * stick,
        )


class Resistance:
    """Wrenches of the soil on the tools that sweep it."""

    def __init__(self, columns: Columns, kinds: Sequence[SoilType]) -> None:
        """
        Args:
            columns: the terrain, read as it is when `wrenches` is called.
            kinds: the kinds of soil in it, by id.
        """
        self._columns = columns
        self._strength = Strength.of(kinds)
        grid = columns.grid
        self._frame = (grid.rows, grid.cols, grid.cell, grid.x_first, grid.y_first)

    def wrenches(self, sweeps: Rows) -> Rows:
        """FORCE rows of a tick, one per tool; call it before the tick's cut.

        The point of application is the mean of where the forces act at the end of the tick, by
        their strength: of a level cut over the lip's middle, a third of the depth above it.

        Args:
            sweeps: sound SWEEP rows, by source and tool.
        """
        forces = no_resistance(sweeps)
        if forces.size == 0:  # as in ticks without a machine
            return forces
        axes = [sweeps[name] for name in ("x0", "y0", "z0", "x1", "y1", "z1")]
        points = np.stack(axes, axis=-1).astype(np.float64).reshape(-1, 2, 3)
        found = _wrenches(
            points, first_of_tools(sweeps), sweeps["action"], self._columns.arrays, self._frame,
            self._strength,
        )  # fmt: skip
        for n, name in enumerate(("x", "y", "z", "fx", "fy", "fz", "tx", "ty", "tz")):
            forces[name] = found[:, n]
        return forces


def no_resistance(sweeps: Rows) -> Rows:
    """One FORCE row of zeros a tool, at its first key point: no force is said to be zero.

    Args:
        sweeps: sound SWEEP rows, by source and tool.
    """
    first = sweeps[first_of_tools(sweeps)]
    forces = empty_rows(FORCE, first.size)
    forces["source"], forces["tool"] = first["source"], first["tool"]
    forces["x"], forces["y"], forces["z"] = first["x1"], first["y1"], first["z1"]
    return forces


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

    along: tuple[float, float, float]
    off: tuple[float, float, float]
    ahead: tuple[float, float]
    width: float
    rake: float
    height: float
    counts: float


@njit(cache=True)
def _wrenches(  # type: ignore[no-untyped-def]
    points, first, action, columns, frame, strength
):
    """Point [m], force [N] and torque about the point [N m] of each tool, shape (tools, 9)."""
    out = np.zeros((first.size, 9))
    sums = np.empty(10)
    for n in range(first.size):
        end = first[n + 1] if n + 1 < first.size else len(points)
        own = points[first[n] : end]
        middle = 0.5 * (own[0, 1] + own[1, 1])
        out[n, :3] = middle
        if len(own) < 4:  # one pair alone is an edge without a plate: it has no rake
            continue
        sums[:] = 0.0
        if action[first[n]] == Action.CUT:
            travel = _travel(own)
            if travel.counts > 0.0:
                _add_strips(own[0, 1], own[1, 1], middle, travel, columns, frame, strength, sums)
        _add_bearing(own, middle, columns, frame, strength, sums)
        if sums[9] > 0.0:
            at = sums[6:9] / sums[9]
            out[n, :3] += at
            out[n, 3:6] = sums[:3]
            out[n, 6:] = sums[3:6] - np.cross(at, sums[:3])
    return out


@njit(cache=True)
def _add_force(sums, x, y, z, fx, fy, fz):  # type: ignore[no-untyped-def]
    """Add a force [N] at a place [m] to force, torque, place by strength, strength, shape (10,)."""
    size = math.sqrt(fx * fx + fy * fy + fz * fz)
    sums[0] += fx
    sums[1] += fy
    sums[2] += fz
    sums[3] += y * fz - z * fy
    sums[4] += z * fx - x * fz
    sums[5] += x * fy - y * fx
    sums[6] += size * x
    sums[7] += size * y
    sums[8] += size * z
    sums[9] += size


@njit(cache=True)
def _column_at(x, y, frame):  # type: ignore[no-untyped-def]
    """Flat index of the column at a place [m]; -1 beyond the map."""
    rows, cols, cell, x_first, y_first = frame
    row = int(math.floor((x_first - x) / cell + 0.5))
    col = int(math.floor((y_first - y) / cell + 0.5))
    if 0 <= row < rows and 0 <= col < cols:
        return row * cols + col
    return -1


@njit(cache=True)
def _travel(points):  # type: ignore[no-untyped-def]
    """The travel of one tool by its key points, shape (rows, 2, 3)."""
    none = _Travel((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0), 0.0, 0.0, 0.0, 0.0)
    lip = 0.5 * (points[0, 1] + points[1, 1])
    way = lip - 0.5 * (points[0, 0] + points[1, 0])
    length = math.sqrt((way**2).sum())
    if length < _AT_REST:
        return none
    t = way / length
    n = np.cross(t, points[1, 1] - points[0, 1])
    width = math.sqrt((n**2).sum())
    if width < 1e-6:
        return none
    n /= width
    plate = 0.5 * (points[2, 1] + points[3, 1]) - lip
    behind, beside = -(plate * t).sum(), (plate * n).sum()
    rest = np.zeros(3)
    top = lip[2]
    for row in range(len(points)):
        rest += points[row, 1] - lip
        top = max(top, points[row, 1, 2])
    # The inside's normal is (beside, behind) in t and n; n is turned until the rest is there.
    inside = (rest * t).sum() * beside + (rest * n).sum() * behind
    alone = abs(inside) <= 1e-6 * len(points)
    if beside < 0.0 if alone else inside < 0.0:
        n, beside = -n, -beside
    if beside <= 0.0 and behind <= 0.0:
        return none
    counts = min(1.0, 1.0 + n[2]) if t[2] < 0.0 else max(n[2], 0.0)
    dive = max(-t[2], 0.0)
    ax, ay = t[0] + dive * n[0], t[1] + dive * n[1]
    ahead = math.hypot(ax, ay)
    if ahead > 1e-6:
        ax, ay = ax / ahead, ay / ahead
    rake = math.atan2(max(beside, 0.0), behind)
    return _Travel(
        (t[0], t[1], t[2]), (n[0], n[1], n[2]), (ax, ay), width, rake, top - lip[2], counts
    )


@njit(cache=True)
def _add_strips(  # type: ignore[no-untyped-def]
    left, right, middle, travel, columns, frame, strength, sums
):
    """Add what resists the strips of a lip from left to right [m]; places from its middle."""
    t, n = travel.along, travel.off
    ahead = _AHEAD * frame[2]
    for strip in range(_STRIPS):
        at = left + (strip + 0.5) / _STRIPS * (right - left)
        i = _column_at(at[0] + ahead * travel.ahead[0], at[1] + ahead * travel.ahead[1], frame)
        if i < 0 or columns.height[i] <= at[2]:
            continue
        below = columns.height[i] - at[2]
        against, off = _strip_force(i, below, travel, columns, strength)
        depth = travel.counts * min(below, travel.height)
        at -= middle
        _add_force(
            sums, at[0], at[1], at[2] + depth / 3.0,
            off * n[0] - against * t[0], off * n[1] - against * t[1], off * n[2] - against * t[2],
        )  # fmt: skip


@njit(cache=True)
def _add_bearing(points, middle, columns, frame, strength, sums):  # type: ignore[no-untyped-def]
    """Add what bears the outside of the plates of a tool; places from `middle`."""
    plates = len(points) // 2 - 1
    body = np.zeros(3)
    for row in range(len(points)):
        body += points[row, 1] / len(points)
    on = np.empty(plates * _STRIPS, dtype=np.int64)  # columns pressed on
    pads = np.empty((plates * _STRIPS, 7))  # where, which way, the area shown [m^2]
    count = 0
    for k in range(plates):
        a, b, c, d = points[2 * k], points[2 * k + 1], points[2 * k + 2], points[2 * k + 3]
        way = 0.25 * (a[1] + b[1] + c[1] + d[1] - a[0] - b[0] - c[0] - d[0])
        length = math.sqrt((way**2).sum())
        out = np.cross(b[1] - a[1], 0.5 * (c[1] + d[1] - a[1] - b[1]))
        area = math.sqrt((out**2).sum())
        if length < _AT_REST or area < 1e-9:
            continue
        way /= length
        out /= area
        inward = (out * (body - a[1])).sum()
        if inward > 0.0:
            out = -out
        lead = (out * way).sum()
        # A plate alone has no outside; an upright one does not rest on what its columns hold.
        if abs(inward) < 1e-6 or lead <= 0.0 or out[2] > -_UPRIGHT:
            continue
        for strip in range(_STRIPS):
            share = (strip + 0.5) / _STRIPS
            at = 0.5 * ((1.0 - share) * (a[1] + c[1]) + share * (b[1] + d[1]))
            i = _column_at(at[0], at[1], frame)
            if i < 0:
                continue
            # The plate over the column's middle, against the column as the last tick left it.
            dx = frame[3] - i // frame[1] * frame[2] - at[0]
            dy = frame[4] - i % frame[1] * frame[2] - at[1]
            if columns.height[i] > at[2] - (out[0] * dx + out[1] * dy) / out[2]:
                on[count] = i
                pads[count, :3] = at - middle
                pads[count, 3:6] = way
                pads[count, 6] = area * lead / _STRIPS
                count += 1
    if count == 0:
        return
    width = math.sqrt(((points[1, 1] - points[0, 1]) ** 2).sum())
    breadth = pads[:count, 6].sum() / width
    for n in range(count):
        x, y, z, tx, ty, tz, area = pads[n]
        force = area * _bearing(on[n], breadth, columns, strength)
        _add_force(sums, x, y, z, -force * tx, -force * ty, -force * tz)


@njit(cache=True)
def _bearing(i, breadth, columns, strength):  # type: ignore[no-untyped-def]
    """Bearing capacity of column i [Pa]; loose soil as deep as the tool presses has no cohesion."""
    firm = max(0.0, 1.0 - columns.bulk[i] * columns.metres_per_mm3 / breadth)
    kind = columns.soil[i] if firm > 0.0 else columns.loose_soil[i]
    cohesion = firm * strength.cohesion[kind, columns.moisture[i]]
    weight = 0.5 * breadth * strength.gamma[kind]
    return cohesion * strength.n_c[kind] + weight * strength.n_gamma[kind]


@njit(cache=True)
def _strip_force(i, below, travel, columns, strength):  # type: ignore[no-untyped-def]
    """Forces [N] against the travel and along n on a strip `below` [m] the surface of column i."""
    width = travel.width / _STRIPS
    depth = travel.counts * min(below, travel.height)
    above = min(max(below - travel.height, 0.0), travel.height)
    cover = columns.bulk[i] * columns.metres_per_mm3
    firm = max(0.0, 1.0 - cover / below)  # part of the depth
    kind = columns.soil[i] if firm > 0.0 else columns.loose_soil[i]
    gamma = 0.0
    if firm < 1.0:
        gamma = strength.gamma[columns.loose_soil[i]] * (columns.loose[i] / columns.bulk[i])
    rock = firm > 0.0 and strength.tensile[kind] > 0.0
    against = off = 0.0
    if rock:
        picks = width / _PICK_SPACING
        against = picks * goktan_force(
            firm * depth, _PICK_ANGLE, strength.tensile[kind], _PICK_FRICTION
        )
        off = _PICK_NORMAL * against
        depth *= 1.0 - firm
        cohesion = adhesion = above = 0.0
    else:
        gamma = firm * strength.gamma[kind] + (1.0 - firm) * gamma
        cohesion = firm * strength.cohesion[kind, columns.moisture[i]]
        adhesion = strength.adhesion[kind, columns.moisture[i]]
    horizontal, vertical = blade_force(
        width, depth, travel.rake, gamma * above, gamma, strength.phi[kind], strength.delta[kind],
        cohesion, adhesion,
    )  # fmt: skip
    return against + horizontal, off + vertical
