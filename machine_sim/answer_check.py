"""Validation of the soil's answer before a machine applies any of it.

Rows come from outside. An answer is accepted or rejected as a whole, before the first change: soil
that is half applied could not be accounted. What the soil may credit is bounded by the
machine's own state: the particles it has offered, and the tools whose sweep is answered.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from machine_sim.dem import SoilEngine
from machine_sim.ground.contact_surface import Ground
from machine_sim.tool_soil.coupling import ToolSoilCoupling
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.rows import (
    FORCE,
    FORCE_VECTORS,
    MAX_MILLING_WORK,
    ConversionKind,
    Rows,
    SoilReaction,
)
from msg_bridge.kernels import kernel

__all__ = ["check_conversions", "check_excavation", "check_forces", "check_map_updates"]

_EXCAVATE, _MAX_KIND, _MAX_REACTION = (
    int(ConversionKind.EXCAVATE),
    int(max(ConversionKind)),
    int(max(SoilReaction)),
)

_MAX_COORDINATE = 1e5
"""Largest coordinate in a row [m], that of a map."""

_MAX_WRENCH = 1e9
"""Largest component of a force [N] or torque [N m], far above what breaks every tool."""

_MAX_FORCE_VALUES = np.array([_MAX_COORDINATE] * 3 + [_MAX_WRENCH] * 6)
"""Largest values of `FORCE_VECTORS`."""

_MAX_MOISTURE = 100
"""Largest moisture [% of saturation]."""

_EXCAVATION_MARGIN = 1.0
"""Allowance for the position of excavated soil beside a tool, and for its depth [m].

Other machines and slope failures may have changed the column since the last answer."""


def check_map_updates(map_updates: Rows, ground: Ground) -> None:
    """Check MAP_UPDATE rows: columns of the terrain, with heights and soils that exist.

    Raises:
        ExchangeError: OFF_MAP or VALUE.
    """
    if map_updates.size == 0:
        return
    num_rows, num_cols = ground.grid.shape
    if map_updates["row"].max() >= num_rows or map_updates["col"].max() >= num_cols:
        raise ExchangeError(
            f"a map update lies outside of the {num_rows} x {num_cols} columns of the terrain",
            ErrorCode.OFF_MAP,
        )
    _check_magnitude(map_updates, ("z",), _MAX_COORDINATE, "height of a map update")
    if not np.isfinite(map_updates["volume_mm3"]).all():
        raise ExchangeError("the volume of a map update is not finite", ErrorCode.VALUE)
    _check_soil(map_updates, ground, "map update")


def check_forces(forces: Rows, num_tools: int) -> None:
    """Check FORCE rows: finite wrenches on tools that exist.

    Args:
        forces: the rows of this node.
        num_tools: number of tool ids of this node.

    Raises:
        ExchangeError: VALUE.
    """
    if forces.size == 0:
        return
    if forces["tool"].max() >= num_tools:
        raise ExchangeError(
            f"a force acts on tool {forces['tool'].max()}; this node has {num_tools} tools",
            ErrorCode.VALUE,
        )
    if forces["reaction"].max() > _MAX_REACTION:
        raise ExchangeError(
            f"a force has the reaction {forces['reaction'].max()}; give {min(SoilReaction):d} to"
            f" {max(SoilReaction):d}",
            ErrorCode.VALUE,
        )
    values = np.abs(forces.view(FORCE_VECTORS)["values"]).max(axis=0)
    if not (values <= _MAX_FORCE_VALUES).all():  # NaN compares false
        names = (FORCE.names or ())[: values.size]
        raise ExchangeError(
            "the point and wrench of a force have the magnitudes"
            f" {dict(zip(names, values.tolist(), strict=True))}; give at most"
            f" {_MAX_COORDINATE:g} m, and {_MAX_WRENCH:g} N and N m",
            ErrorCode.VALUE,
        )
    work = forces["work"]
    if not ((work >= 0.0) & (work <= MAX_MILLING_WORK)).all():
        raise ExchangeError(
            f"the work of a FORCE row is not between 0 and {MAX_MILLING_WORK:g} J",
            ErrorCode.VALUE,
        )


def check_conversions(
    conversions: Rows, ground: Ground, particles: SoilEngine, *, can_dig: bool
) -> None:
    """Check CONVERSION rows: excavated soil that exists, and answers to deposit requests.

    Args:
        conversions: the rows of this node.
        ground: the terrain.
        particles: the particles; those whose deposit is requested are frozen.
        can_dig: whether this node has a tool that excavates.

    Raises:
        ExchangeError: VALUE, OFF_MAP, or PARTICLE: an answer to a request that was not made.
    """
    if conversions.size == 0:
        return
    kind = conversions["kind"]
    if kind.max() > _MAX_KIND:
        raise ExchangeError(
            f"a conversion has the kind {kind.max()}; give {min(ConversionKind):d} to"
            f" {max(ConversionKind):d}",
            ErrorCode.VALUE,
        )
    is_excavated = kind == _EXCAVATE
    excavated, answers = conversions[is_excavated], conversions[~is_excavated]
    if excavated.size:
        _check_excavated_soil(excavated, ground, can_dig=can_dig)
    if answers.size:
        _check_deposit_answers(answers, particles)


def check_excavation(
    conversions: Rows, ground: Ground, couplings: Sequence[ToolSoilCoupling], ticks_ago: int
) -> None:
    """Check that no more soil was excavated than the tools can have cut.

    Each EXCAVATE row must lie beside a digging tool, and a column can lose no more than what lies
    above the lowest key point of all digging tools.

    Args:
        conversions: valid CONVERSION rows of this node.
        ground: the terrain before the answer.
        couplings: the digging tools, at least one.
        ticks_ago: number of ticks completed since the answered one.

    Raises:
        ExchangeError: EXCAVATION.
    """
    excavated = conversions[conversions["kind"] == _EXCAVATE]
    if excavated.size == 0:
        return
    is_near = np.zeros(excavated.size, dtype=np.bool_)
    # A column of one row is contiguous, that of several is not: as a copy one kernel serves both.
    x, y = (np.array(excavated[name], dtype=np.float64) for name in "xy")
    lowest = np.inf
    margin = ground.grid.cell + _EXCAVATION_MARGIN
    for coupling in couplings:
        # The sweep of a tick begins at the pose at the end of the tick before.
        frames = (*coupling.frame_at(ticks_ago), *coupling.frame_at(ticks_ago + 1))
        lowest = min(lowest, _mark_near(coupling.key_points, *frames, x, y, margin, is_near))
    if not is_near.all():
        raise ExchangeError(
            "soil was excavated where no tool of this node has been", ErrorCode.EXCAVATION
        )
    volume_of_column = 1e9 * ground.grid.cell**2
    # Usually all rows together have less than what may leave any one column.
    if excavated["volume_mm3"].sum(dtype=np.int64) <= volume_of_column * _EXCAVATION_MARGIN:
        return
    columns, index = np.unique(
        excavated["row"].astype(np.int64) * ground.grid.cols + excavated["col"],
        return_inverse=True,
    )
    volume = np.bincount(index, weights=excavated["volume_mm3"])
    depth = ground.elevation.reshape(-1)[columns] - lowest
    most = volume_of_column * (np.maximum(depth, 0.0) + _EXCAVATION_MARGIN)
    if (volume > most).any():
        excess = int(np.argmax(volume - most))
        raise ExchangeError(
            f"{volume[excess]:.0f} mm^3 were excavated from one column, in which at most"
            f" {most[excess]:.0f} mm^3 lie above the tools of this node",
            ErrorCode.EXCAVATION,
        )


@kernel
def _mark_near(  # type: ignore[no-untyped-def]
    key_points, rotation, origin, earlier_rotation, earlier_origin, x, y, margin, is_near
):
    """Mark the positions beside a tool, and return the height of its lowest key point [m].

    Args:
        key_points: [m], tool frame, shape (n, 3), n >= 1.
        rotation, origin, earlier_rotation, earlier_origin: two poses of the tool.
        x, y: positions [m], map frame, shape (rows,).
        margin: distance from the circle around the key points that counts as beside [m].
        is_near: marks, shape (rows,); updated.
    """
    count = len(key_points)
    points = np.empty((2 * count, 3))
    centre_x = centre_y = 0.0
    for i in range(count):
        for k in range(3):
            points[i, k], points[count + i, k] = origin[k], earlier_origin[k]
            for j in range(3):
                points[i, k] += rotation[k, j] * key_points[i, j]
                points[count + i, k] += earlier_rotation[k, j] * key_points[i, j]
        centre_x += (points[i, 0] + points[count + i, 0]) / (2 * count)
        centre_y += (points[i, 1] + points[count + i, 1]) / (2 * count)
    reach, lowest = 0.0, np.inf
    for i in range(2 * count):
        reach = max(reach, math.hypot(points[i, 0] - centre_x, points[i, 1] - centre_y))
        lowest = min(lowest, points[i, 2])
    for n in range(x.size):
        is_near[n] |= math.hypot(x[n] - centre_x, y[n] - centre_y) <= reach + margin
    return lowest


def _check_excavated_soil(excavated: Rows, ground: Ground, *, can_dig: bool) -> None:
    if not can_dig:
        raise ExchangeError(
            "soil was excavated, but no machine of this node has a digging tool",
            ErrorCode.EXCAVATION,
        )
    num_rows, num_cols = ground.grid.shape
    if excavated["row"].max() >= num_rows or excavated["col"].max() >= num_cols:
        raise ExchangeError(
            f"soil was excavated outside of the {num_rows} x {num_cols} columns of the terrain",
            ErrorCode.OFF_MAP,
        )
    _check_magnitude(excavated, ("x", "y", "z"), _MAX_COORDINATE, "position of excavated soil")
    if excavated["volume_mm3"].min() == 0:
        raise ExchangeError("an excavated parcel has no volume", ErrorCode.VALUE)
    _check_soil(excavated, ground, "conversion")


def _check_deposit_answers(answers: Rows, particles: SoilEngine) -> None:
    """Check that each row answers a request: a frozen particle, once, with its volume."""
    order = np.argsort(particles.ids)
    ids = particles.ids[order]
    at = np.searchsorted(ids, answers["particle_id"])
    is_known = at < ids.size
    is_known[is_known] = ids[at[is_known]] == answers["particle_id"][is_known]
    rows = order[at[is_known]]
    if not is_known.all() or not particles.is_frozen[rows].all():
        raise ExchangeError(
            "a conversion answers a deposit request that this node has not made",
            ErrorCode.PARTICLE,
        )
    if np.unique(rows).size < rows.size:
        raise ExchangeError("two conversions answer one deposit request", ErrorCode.PARTICLE)
    if (particles.volumes_mm3[rows] != answers["volume_mm3"]).any():
        raise ExchangeError(
            "a conversion answers a deposit request with another volume than was requested",
            ErrorCode.PARTICLE,
        )


def _check_soil(rows: Rows, ground: Ground, of: str) -> None:
    if rows["soil"].max() >= len(ground.soils):
        raise ExchangeError(
            f"a {of} has the soil id {rows['soil'].max()}; the run has {len(ground.soils)} soils",
            ErrorCode.VALUE,
        )
    if rows["moisture"].max() > _MAX_MOISTURE:
        raise ExchangeError(
            f"a {of} has a moisture of {rows['moisture'].max()} %; give at most {_MAX_MOISTURE} %",
            ErrorCode.VALUE,
        )


def _check_magnitude(rows: Rows, names: Sequence[str], limit: float, of: str) -> None:
    """Check that fields are finite and at most `limit` in magnitude."""
    for name in names:
        value = np.abs(rows[name]).max()
        if not value <= limit:  # NaN compares false
            raise ExchangeError(
                f"the {of}, {name}, is {value}; give at most {limit:g}", ErrorCode.VALUE
            )
