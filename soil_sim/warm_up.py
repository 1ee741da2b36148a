"""Compile every kernel before the first tick."""

from __future__ import annotations

from functools import cache

import numpy as np

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import (
    DEPOSIT_REQUEST,
    SWEEP,
    Rows,
    SweepAction,
    empty_rows,
    join_rows,
)
from soil_sim.columns.occupancy import TOOL_INSIDE
from soil_sim.soil import Soil
from soil_sim.soil_inventory import SoilInventory
from soil_sim.soils.params import SoilParams
from soil_sim.sweep_limits import SweepLimits
from soil_sim.tool_sweeps import positions_of_first_tools

__all__ = ["warm_up"]

_NUM_TICKS = 4
"""Ticks of the sweep: the plate enters the soil and moves on, and soil slides behind it."""


@cache
def warm_up(params: SoilParams) -> None:
    """Dig and fill a small terrain; takes seconds with an empty cache, much less otherwise.

    What was compiled or loaded by a process is not done again in it.

    Args:
        params: parameters of the soil to run later: its cut mode is compiled.
    """
    grid = Grid(16, 16, 0.2)
    soil = Soil(grid, np.zeros(grid.shape), params)
    soil.state_hash()
    inventory, limits = SoilInventory(), SweepLimits(1.0)
    deposit_requests = empty_rows(DEPOSIT_REQUEST, 2)
    deposit_requests["volume_mm3"] = 200_000_000  # a pile too steep to stand
    deposit_requests["particle_id"] = (0, 1)
    for tick in range(1, _NUM_TICKS + 1):
        cut = empty_rows(SWEEP, 4)
        cut["pair"] = (0, 0, 1, 1)
        cut["y0"] = cut["y1"] = (0.5, -0.5, 0.5, -0.5)
        cut["z0"] = cut["z1"] = (-0.3, -0.3, 0.2, 0.2)
        cut["x0"], cut["x1"] = 0.1 * tick, 0.1 * (tick + 1)
        cut["room_mm3"] = 100_000_000 if tick == 1 else 1_000_000  # then pushes the rest ahead
        track = cut.copy()
        track["tool"], track["action"], track["pressure"] = 1, SweepAction.COMPACT, 1e4
        positions_of_first_tools(cut)
        limits.check(tick, cut)
        drum = cut.copy()
        drum["tool"], drum["action"], drum["work"] = 2, SweepAction.MILL, 100.0
        parked_drum = _closed_ring()
        step = soil.step(
            tick,
            join_rows([cut, track, drum, parked_drum], SWEEP),
            deposit_requests if tick == 1 else empty_rows(DEPOSIT_REQUEST),
        )
        inventory.record_conversions(step.conversions, {0: 1})
    soil.step(_NUM_TICKS + 1, empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST))
    soil.state_hash()
    _collapse_cliff(params)


def _closed_ring() -> Rows:
    """Return the sweep of a drum that is not driven, tool 3."""
    rows = empty_rows(SWEEP, 10)
    rows["pair"], rows["tool"], rows["action"] = np.arange(10) // 2, 3, SweepAction.COMPACT
    rows["x0"] = rows["x1"] = np.repeat((0.3, 0.0, -0.3, 0.0, 0.3), 2)
    rows["z0"] = rows["z1"] = np.repeat((0.0, 0.3, 0.0, -0.3, 0.0), 2)
    rows["y0"] = rows["y1"] = (1.5, 1.2) * 5
    return rows


def _collapse_cliff(params: SoilParams) -> None:
    """Let a cliff collapse beside a tool, which compiles the kernels that relax a window."""
    heights = np.zeros((16, 16))
    heights[:8] = 8.0
    soil = Soil(Grid(16, 16, 0.2), heights, params)
    soil.relaxation.occupied[2, 2] = TOOL_INSIDE
    soil.relaxation.mark_all_disturbed()
    soil.relaxation.relax()
