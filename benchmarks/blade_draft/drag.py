"""Drag a blade through the terrain of this project, without a machine."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from benchmarks.blade_draft.blade import HEIGHT, SPEED, Blade, Drag
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, Rows, SoilReaction, empty_rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

__all__ = ["drag_blade"]

_SANDS = Path(__file__).with_name("sands.yaml")
_AHEAD, _BESIDE = 1.7, 1.4
"""Ground ahead of the end of the drag and beside the blade, both sides together [m]."""
_PLANE_WIDTH = 8.0
"""Width of a blade whose ends hardly count [m]."""
_STEP = 0.01 * SPEED
"""Travel in a tick of 10 ms [m]."""


def drag_blade(blade: Blade, travel: float, cell: float) -> Drag:
    """Return the forces on a blade that starts at its depth.

    Args:
        blade: the blade.
        travel: distance [m].
        cell: cell size of the terrain [m].
    """
    width = blade.width if math.isfinite(blade.width) else _PLANE_WIDTH
    grid = Grid(round((travel + _AHEAD) / cell) + 1, round((width + _BESIDE) / cell) + 1, cell)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil=blade.soil, soils=str(_SANDS)))
    no_requests = empty_rows(DEPOSIT_REQUEST)
    forces = []
    for tick in range(round(travel / _STEP)):
        x = tick * _STEP - 0.5 * travel - 0.3
        rows = soil.step(tick, _sweep(blade, width, x), no_requests).forces
        cut = rows[rows["reaction"] == SoilReaction.CUT]
        forces.append((-cut["fx"].sum(), cut["fz"].sum()))
    per_metre = width if not math.isfinite(blade.width) else 1.0
    table = np.asarray(np.divide(forces, per_metre), dtype=np.float64)
    distance = np.linspace(_STEP, travel, len(table))
    return Drag(distance, table[:, 0], table[:, 1])


def _sweep(blade: Blade, width: float, x: float) -> Rows:
    """Return the sweep of a tick of a plane blade that takes no soil in."""
    rows = empty_rows(SWEEP, 6)
    rows["machine_id"] = 1
    rows["pair"] = np.repeat(np.arange(3), 2)
    rows["room_mm3"] = 0
    above = np.repeat(np.linspace(0.0, HEIGHT, 3), 2)
    rows["x0"] = x - above / math.tan(math.radians(blade.rake))
    rows["x1"] = rows["x0"] + _STEP
    rows["y0"] = rows["y1"] = np.tile([0.5 * width, -0.5 * width], 3)
    rows["z0"] = rows["z1"] = above - blade.depth
    return rows
