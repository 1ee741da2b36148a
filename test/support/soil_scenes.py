"""Sweeps, deposit requests and measurements that tests of the soil share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import (
    DEPOSIT_REQUEST,
    SWEEP,
    UNLIMITED_ROOM,
    ConversionKind,
    Rows,
    empty_rows,
)
from soil_sim.columns.operations import pack_firm
from soil_sim.soil import Soil, SoilStepResult
from soil_sim.soils.params import SoilParams

BUCKET_PROFILE = ((0, 0), (-0.4, 0), (-0.7, 0.1), (-0.9, 0.3), (-1, 0.5), (-1, 0.8), (-0.9, 1.0))
"""(x, z) of the seven key points of a bucket, behind and above its lip [m]."""

NO_SWEEPS = empty_rows(SWEEP)
NO_DEPOSIT_REQUESTS = empty_rows(DEPOSIT_REQUEST)


def reference_soil(**params: object) -> SoilParams:
    """Return parameters of a soil that stands at 30 degrees and does not swell, by default."""
    reference = {} if "soil" in params else {"repose_angle": 30.0, "swell": 0.0}
    return SoilParams(**{**reference, **params})  # type: ignore[arg-type]


def flat_soil(size: float = 12.0, cell: float = 0.2, **params: object) -> Soil:
    """Return level soil at height 0, `size` [m] wide, of `reference_soil`."""
    n = int(round(size / cell)) + 1
    grid = Grid(n, n, cell)
    return Soil(grid, np.zeros(grid.shape), reference_soil(**params))


def make_deposit_requests(x: object, y: object, volume_mm3: int) -> Rows:
    """Return DEPOSIT_REQUEST rows of machine 1 at some positions [m], `volume_mm3` each."""
    x, y = np.broadcast_arrays(np.atleast_1d(x), np.atleast_1d(y))  # type: ignore[arg-type]
    rows = empty_rows(DEPOSIT_REQUEST, x.size)
    rows["x"], rows["y"], rows["volume_mm3"], rows["machine_id"] = x, y, volume_mm3, 1
    rows["particle_id"] = np.arange(1, x.size + 1)
    return rows


def tool_sweep(
    profile: Sequence[tuple[float, float]],
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    width: float = 1.2,
) -> Rows:
    """Return SWEEP rows of machine 1 for a tool with key points at `profile` (x, z) from its lip.

    The middle of the lip moves from `start` to `end` (x, y, z) [m]. The pairs are parallel to y.
    """
    rows = empty_rows(SWEEP, 2 * len(profile))
    rows["room_mm3"] = UNLIMITED_ROOM
    for pair, (x, z) in enumerate(profile):
        for side, y in ((0, width / 2), (1, -width / 2)):
            row = rows[2 * pair + side]
            row["pair"], row["machine_id"] = pair, 1
            for axis, offset, a, b in zip("xyz", (x, y, z), start, end, strict=True):
                row[f"{axis}0"], row[f"{axis}1"] = a + offset, b + offset
    return rows


def bucket_sweep(
    start: tuple[float, float, float], end: tuple[float, float, float], width: float = 1.2
) -> Rows:
    """Return SWEEP rows of a bucket that digs toward +x; arguments as of `tool_sweep`."""
    return tool_sweep(BUCKET_PROFILE, start, end, width)


def drag_tool(
    soil: Soil, profile: Sequence[tuple[float, float]], *, depth: float, step: float
) -> float:
    """Drag a tool 1 m toward +x through soil whose slopes do not fail.

    Returns:
        The volume that the soil lost [m^3].
    """
    soil.relaxation.is_enabled = False
    before = soil.total_mm3
    x = np.linspace(-0.5, 0.5, round(1.0 / step) + 1)
    for tick, (a, b) in enumerate(pairwise([x[0], *x])):
        soil.step(tick, tool_sweep(profile, (a, 0, -depth), (b, 0, -depth)), NO_DEPOSIT_REQUESTS)
    return (before - soil.total_mm3) / 1e9


def scoop(soil: Soil, *, depth: float, length: float, speed: float = 1.0, y: float = 0.0) -> int:
    """Push a bucket in, drag it and lift it out; return the excavated bank volume [mm^3]."""
    step = speed * 0.01
    x, z = -length / 2, 0.02
    path = [(x, y, z)]
    while path[-1][2] > -depth:
        path.append((x, y, max(path[-1][2] - step, -depth)))
    while path[-1][0] < length / 2:
        path.append((min(path[-1][0] + step, length / 2), y, -depth))
    while path[-1][2] < 0.3:
        path.append((length / 2, y, path[-1][2] + step))
    return sum(
        excavated_mm3(soil.step(tick, bucket_sweep(a, b), NO_DEPOSIT_REQUESTS))
        for tick, (a, b) in enumerate(pairwise(path))
    )


def excavated_mm3(step: SoilStepResult) -> int:
    """Return the bank volume that a tick excavated [mm^3]."""
    rows = step.conversions[step.conversions["kind"] == ConversionKind.EXCAVATE]
    return int(rows["volume_mm3"].astype(np.int64).sum())


def come_to_rest(soil: Soil) -> Soil:
    """Relax the slopes of a soil until nothing moves; return the soil."""
    while soil.relaxation.relax(10**7):
        pass
    return soil


def pour_pile(
    cell: float, angle: float, volume: float, radius: float = 4.0, parts: int = 4000
) -> Soil:
    """Return a pile of `volume` [m^3], deposited at one point in many parts, at rest."""
    reach = (3 * volume / math.pi / math.tan(math.radians(angle))) ** (1 / 3)
    soil = flat_soil(3.2 * reach, cell, repose_angle=angle, relaxation_radius=radius)
    for tick in range(parts):
        soil.step(tick, NO_SWEEPS, make_deposit_requests(0.0, 0.0, round(volume * 1e9 / parts)))
    return come_to_rest(soil)


def contour_radii(soil: Soil, level: float, directions: int = 72) -> NDArray[np.float64]:
    """Return the radius of a contour line of a pile in evenly spaced directions [m].

    The distance from the middle of the map to where the surface falls below `level` [m].
    """
    grid, height = soil.grid, soil.columns.height
    r = np.arange(0.0, 0.5 * grid.size[0], 0.02 * grid.cell)
    radii = np.empty(directions)
    for k, phi in enumerate(2 * math.pi * np.arange(directions) / directions):
        row, col = grid.row(r * math.cos(phi)), grid.col(r * math.sin(phi))
        i, j = row.astype(int), col.astype(int)
        i, j = np.clip(i, 0, grid.rows - 2), np.clip(j, 0, grid.cols - 2)
        u, v = row - i, col - j
        z = (height[i, j] * (1 - v) + height[i, j + 1] * v) * (1 - u) + (
            height[i + 1, j] * (1 - v) + height[i + 1, j + 1] * v
        ) * u
        radii[k] = r[np.argmax(z < level)]
    return radii


def packed_soil(rut_depth: float) -> Soil:
    """Return level loam that was pressed down everywhere by a depth [m]."""
    soil = flat_soil(6.0, 0.2, soil="loam")
    soil.relaxation.is_enabled = False
    columns = soil.columns
    for i in range(columns.height.size):
        pack_firm(columns.arrays, i, rut_depth / columns.metres_per_mm3)
    return soil
