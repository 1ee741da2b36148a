"""Sweeps, landings and measurements that tests of the soil share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, Rows, empty_rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

BUCKET_PROFILE = ((0, 0), (-0.4, 0), (-0.7, 0.1), (-0.9, 0.3), (-1, 0.5), (-1, 0.8), (-0.9, 1.0))
"""(x, z) of a bucket's seven key points behind and above its lip [m]."""

NO_SWEEPS = empty_rows(SWEEP)
NO_DEPOSIT_REQUESTS = empty_rows(DEPOSIT_REQUEST)


def flat_soil(size: float = 12.0, cell: float = 0.2, **params: object) -> Soil:
    """Level soil at height 0, `size` metres wide."""
    n = int(round(size / cell)) + 1
    grid = Grid(n, n, cell)
    return Soil(grid, np.zeros(grid.shape), SoilParams(**params))  # type: ignore[arg-type]


def make_deposit_requests(x: object, y: object, volume_mm3: int) -> Rows:
    """LANDED rows of one source, `volume_mm3` each."""
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
    """A tool with key points at `profile` (x, z) from its lip, whose middle moves start to end [m].

    Its pairs lie across, along y.
    """
    rows = empty_rows(SWEEP, 2 * len(profile))
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
    """A bucket whose lip's middle moves from `start` to `end` (x, y, z) [m], digging toward +x."""
    return tool_sweep(BUCKET_PROFILE, start, end, width)


def drag_tool(
    soil: Soil, profile: Sequence[tuple[float, float]], *, depth: float, step: float
) -> float:
    """Drag a tool 1 m toward +x from where it stands in the soil, which does not slip.

    Returns:
        The volume the soil lost [m^3].
    """
    soil.relaxation.relax = lambda budget=None: 0  # type: ignore[method-assign]
    before = soil.total_mm3
    x = np.linspace(-0.5, 0.5, round(1.0 / step) + 1)
    for tick, (a, b) in enumerate(pairwise([x[0], *x])):
        soil.step(tick, tool_sweep(profile, (a, 0, -depth), (b, 0, -depth)), NO_DEPOSIT_REQUESTS)
    return (before - soil.total_mm3) / 1e9


def scoop(soil: Soil, *, depth: float, length: float, speed: float = 1.0, y: float = 0.0) -> int:
    """Push a bucket in, drag it and lift it out; returns the bank volume it took [mm^3]."""
    step = speed * 0.01
    x, z = -length / 2, 0.02
    path = [(x, y, z)]
    while path[-1][2] > -depth:
        path.append((x, y, max(path[-1][2] - step, -depth)))
    while path[-1][0] < length / 2:
        path.append((min(path[-1][0] + step, length / 2), y, -depth))
    while path[-1][2] < 0.3:
        path.append((length / 2, y, path[-1][2] + step))
    taken = 0
    for tick, (a, b) in enumerate(pairwise(path)):
        moved = soil.step(tick, bucket_sweep(a, b), NO_DEPOSIT_REQUESTS).conversions
        taken += int(moved["volume_mm3"].astype(np.int64).sum())
    return taken


def pour_pile(
    cell: float, angle: float, volume: float, radius: float = 4.0, parts: int = 4000
) -> Soil:
    """A pile of `volume` [m^3] landed at one point, a little at a time, at rest."""
    reach = (3 * volume / math.pi / math.tan(math.radians(angle))) ** (1 / 3)
    soil = flat_soil(3.2 * reach, cell, repose_angle=angle, relaxation_radius=radius)
    for tick in range(parts):
        soil.step(tick, NO_SWEEPS, make_deposit_requests(0.0, 0.0, round(volume * 1e9 / parts)))
    while soil.relaxation.relax(10**7):
        pass
    return soil


def contour_radii(soil: Soil, level: float, directions: int = 72) -> NDArray[np.float64]:
    """Distance [m] from the middle to where the surface falls below `level`, per direction."""
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
