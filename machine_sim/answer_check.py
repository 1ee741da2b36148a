"""Validation of the soil's answer before a machine applies any of it.

Rows come from outside. An answer is accepted or rejected as a whole, before the first change: soil
that is half applied could not be accounted. What the soil may credit is bounded by the
machine's own state: the particles it has offered, and the tools whose sweep is answered.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import NoReturn

import numpy as np

from machine_sim.conversion_kinds import split_kind
from machine_sim.dem import ParticleError, SoilEngine
from machine_sim.ground.contact_surface import Ground
from machine_sim.tool_soil.coupling import ToolSoilCoupling
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.rows import (
    MAX_MILLING_WORK,
    ConversionKind,
    Rows,
    SoilReaction,
    has_kind,
)
from msg_bridge.kernels import helper, kernel

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

_MAX_MOISTURE = 100
"""Largest moisture [% of saturation]."""

_EXCAVATION_MARGIN = 1.0
"""Allowance for the position of excavated soil beside a tool, and for its depth [m].

Other machines and slope failures may have changed the column since the last answer."""


class _Fault(IntEnum):
    """What is wrong with a row."""

    NONE = 0
    OFF_MAP = 1
    COORDINATE = 2
    VOLUME = 3
    SOIL = 4
    MOISTURE = 5
    TOOL = 6
    REACTION = 7
    WRENCH = 8
    WORK = 9
    KIND = 10
    RUT_DEPTH = 11


_FAULT_MESSAGES = {
    _Fault.OFF_MAP: "it lies outside of the columns of the terrain",
    _Fault.COORDINATE: f"a coordinate is not finite or beyond {_MAX_COORDINATE:g} m",
    _Fault.VOLUME: "its volume is not finite, or the volume of excavated soil is 0",
    _Fault.SOIL: "the run has no soil with its id",
    _Fault.MOISTURE: f"its moisture is above {_MAX_MOISTURE} %",
    _Fault.TOOL: "this node has no tool with its id",
    _Fault.REACTION: f"its reaction is not {min(SoilReaction):d} to {max(SoilReaction):d}",
    _Fault.WRENCH: f"its force or torque is not finite or beyond {_MAX_WRENCH:g} N and N m",
    _Fault.WORK: f"its work is not between 0 and {MAX_MILLING_WORK:g} J",
    _Fault.RUT_DEPTH: f"its depth of a rut is not between 0 and {_MAX_COORDINATE:g} m",
    _Fault.KIND: f"its kind is not {min(ConversionKind):d} to {max(ConversionKind):d}",
}

_NO_FAULT, _OFF_MAP, _COORDINATE, _VOLUME, _SOIL, _MOISTURE = (
    int(_Fault.NONE),
    int(_Fault.OFF_MAP),
    int(_Fault.COORDINATE),
    int(_Fault.VOLUME),
    int(_Fault.SOIL),
    int(_Fault.MOISTURE),
)
_TOOL, _REACTION, _WRENCH, _WORK, _KIND, _RUT_DEPTH = (
    int(_Fault.TOOL),
    int(_Fault.REACTION),
    int(_Fault.WRENCH),
    int(_Fault.WORK),
    int(_Fault.KIND),
    int(_Fault.RUT_DEPTH),
)


def check_map_updates(map_updates: Rows, ground: Ground) -> None:
    """Check MAP_UPDATE rows: columns of the terrain, with heights and soils that exist.

    Raises:
        ExchangeError: OFF_MAP or VALUE.
    """
    if map_updates.size == 0:
        return
    fault, n = _find_map_update_fault(map_updates, ground.grid.shape, len(ground.soils))
    if fault != _NO_FAULT:
        _reject("MAP_UPDATE", map_updates[n], fault)


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
    fault, n = _find_force_fault(forces, num_tools)
    if fault != _NO_FAULT:
        _reject("FORCE", forces[n], fault)


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
        ExchangeError: VALUE, OFF_MAP, EXCAVATION: soil that no tool of this node can have
            excavated; PARTICLE: an answer to a request that was not made.
    """
    if conversions.size == 0:
        return
    fault, n = _find_conversion_fault(conversions, ground.grid.shape, len(ground.soils))
    if fault != _NO_FAULT:
        _reject("CONVERSION", conversions[n], fault)
    if not can_dig and has_kind(conversions, _EXCAVATE):
        raise ExchangeError(
            "soil was excavated, but no machine of this node has a digging tool",
            ErrorCode.EXCAVATION,
        )
    _check_deposit_answers(conversions, particles)


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
    if not has_kind(conversions, _EXCAVATE):
        return
    is_near = np.zeros(conversions.size, dtype=np.bool_)
    num_far, total, lowest = 0, 0, np.inf
    margin = ground.grid.cell + _EXCAVATION_MARGIN
    for coupling in couplings:
        # The sweep of a tick begins at the pose at the end of the tick before.
        frames = (*coupling.frame_at(ticks_ago), *coupling.frame_at(ticks_ago + 1))
        bottom, num_far, total = _mark_near(
            coupling.key_points, *frames, conversions, margin, is_near
        )
        lowest = min(lowest, bottom)
    if num_far > 0:
        raise ExchangeError(
            "soil was excavated where no tool of this node has been", ErrorCode.EXCAVATION
        )
    volume_of_column = 1e9 * ground.grid.cell**2
    # Usually all rows together have less than what may leave any one column.
    if total <= volume_of_column * _EXCAVATION_MARGIN:
        return
    excavated = conversions[conversions["kind"] == _EXCAVATE]
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
    key_points, rotation, origin, earlier_rotation, earlier_origin, rows, margin, is_near
):
    """Mark the EXCAVATE rows beside a tool.

    Args:
        key_points: [m], tool frame, shape (n, 3), n >= 1.
        rotation, origin, earlier_rotation, earlier_origin: two poses of the tool.
        rows: CONVERSION rows, shape (rows,).
        margin: distance from the circle around the key points that counts as beside [m].
        is_near: marks, shape (rows,); updated.

    Returns:
        Height of the lowest key point of the tool [m], and of the EXCAVATE rows the number without
        a mark and the volume [mm^3].
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
    num_far, volume = 0, 0
    for n in range(rows.size):
        if rows[n].kind != _EXCAVATE:
            continue
        x, y = np.float64(rows[n].x), np.float64(rows[n].y)
        is_near[n] |= math.hypot(x - centre_x, y - centre_y) <= reach + margin
        num_far += not is_near[n]
        volume += np.int64(rows[n].volume_mm3)
    return lowest, num_far, volume


def _check_deposit_answers(conversions: Rows, particles: SoilEngine) -> None:
    """Check that each answer is to a request: a frozen particle, once, with its volume."""
    _, answers = split_kind(conversions, _EXCAVATE)
    if answers.size == 0:
        return
    try:
        rows = particles.rows_of(answers["particle_id"])
    except ParticleError as error:
        raise ExchangeError(
            f"a conversion answers no deposit request: {error}", ErrorCode.PARTICLE
        ) from error
    if not particles.is_frozen[rows].all():
        raise ExchangeError(
            "a conversion answers a deposit request that this node has not made",
            ErrorCode.PARTICLE,
        )
    if (particles.volumes_mm3[rows] != answers["volume_mm3"]).any():
        raise ExchangeError(
            "a conversion answers a deposit request with another volume than was requested",
            ErrorCode.PARTICLE,
        )


def _reject(name: str, row: np.void, fault: int) -> NoReturn:
    """Raise the error of a row with a fault."""
    code = ErrorCode.OFF_MAP if fault == _Fault.OFF_MAP else ErrorCode.VALUE
    raise ExchangeError(f"a {name} row is invalid, {_FAULT_MESSAGES[_Fault(fault)]}: {row}", code)


@kernel
def _find_map_update_fault(rows, shape, num_soils):  # type: ignore[no-untyped-def]
    """Return the first `_Fault` of MAP_UPDATE rows, and the index of its row.

    Args:
        rows: MAP_UPDATE rows.
        shape: numbers of rows and columns of the terrain.
        num_soils: number of soils of the run.
    """
    for n in range(rows.size):
        row = rows[n]
        fault = _find_column_fault(row, shape, num_soils)
        if fault != _NO_FAULT:
            return fault, n
        if not abs(row.z) <= _MAX_COORDINATE:  # NaN compares false
            return _COORDINATE, n
        if not np.isfinite(row.volume_mm3):
            return _VOLUME, n
        if not 0.0 <= row.rut_depth <= _MAX_COORDINATE:
            return _RUT_DEPTH, n
    return _NO_FAULT, 0


@kernel
def _find_force_fault(rows, num_tools):  # type: ignore[no-untyped-def]
    """Return the first `_Fault` of FORCE rows, and the index of its row."""
    for n in range(rows.size):
        row = rows[n]
        if row.tool >= num_tools:
            return _TOOL, n
        if row.reaction > _MAX_REACTION:
            return _REACTION, n
        for coordinate in (row.x, row.y, row.z):
            if not abs(coordinate) <= _MAX_COORDINATE:  # NaN compares false
                return _COORDINATE, n
        for component in (row.fx, row.fy, row.fz, row.tx, row.ty, row.tz):
            if not abs(component) <= _MAX_WRENCH:
                return _WRENCH, n
        if not 0.0 <= row.work <= MAX_MILLING_WORK:
            return _WORK, n
    return _NO_FAULT, 0


@kernel
def _find_conversion_fault(rows, shape, num_soils):  # type: ignore[no-untyped-def]
    """Return the first `_Fault` of CONVERSION rows, and the index of its row.

    Of answers to deposit requests only the kind is checked: the machine has the particle.

    Args:
        rows: CONVERSION rows.
        shape, num_soils: as for `_find_map_update_fault`.
    """
    for n in range(rows.size):
        row = rows[n]
        if row.kind > _MAX_KIND:
            return _KIND, n
        if row.kind != _EXCAVATE:
            continue
        fault = _find_column_fault(row, shape, num_soils)
        if fault != _NO_FAULT:
            return fault, n
        for coordinate in (row.x, row.y, row.z):
            if not abs(coordinate) <= _MAX_COORDINATE:  # NaN compares false
                return _COORDINATE, n
        if row.volume_mm3 == 0:
            return _VOLUME, n
    return _NO_FAULT, 0


@helper
def _find_column_fault(row, shape, num_soils):  # type: ignore[no-untyped-def]
    """Return the first `_Fault` of the column and the soil of a row."""
    if row.row >= shape[0] or row.col >= shape[1]:
        return _OFF_MAP
    if row.soil >= num_soils:
        return _SOIL
    if row.moisture > _MAX_MOISTURE:
        return _MOISTURE
    return _NO_FAULT
