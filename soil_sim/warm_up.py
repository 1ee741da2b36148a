"""Compile every kernel before the first real tick."""

from __future__ import annotations

import numpy as np

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, SweepAction, empty_rows, join_rows
from soil_sim.soil import Soil
from soil_sim.soil_inventory import SoilInventory
from soil_sim.soils.params import SoilParams

__all__ = ["warm_up"]

_TICKS = 4
"""Ticks of the stroke: the plate goes in, on, and the soil that fell back slips."""


def warm_up(params: SoilParams) -> None:
    """Dig and fill a tiny terrain; seconds with an empty cache, else much less.

    Args:
        params: of the soil to come, whose way of cutting is compiled.
    """
    grid = Grid(16, 16, 0.2)
    soil = Soil(grid, np.zeros(grid.shape), params)
    soil.state_hash()
    held = SoilInventory()
    deposit_requests = empty_rows(DEPOSIT_REQUEST, 2)
    deposit_requests["volume_mm3"] = 200_000_000  # steep enough to slip
    deposit_requests["particle_id"] = (0, 1)
    for tick in range(1, _TICKS + 1):
        sweeps = empty_rows(SWEEP, 4)
        sweeps["pair"] = (0, 0, 1, 1)
        sweeps["y0"] = sweeps["y1"] = (0.5, -0.5, 0.5, -0.5)
        sweeps["z0"] = sweeps["z1"] = (-0.3, -0.3, 0.2, 0.2)
        sweeps["x0"], sweeps["x1"] = 0.1 * tick, 0.1 * (tick + 1)
        track = sweeps.copy()
        track["tool"], track["action"] = 1, SweepAction.COMPACT
        drum = sweeps.copy()
        drum["tool"], drum["action"] = 2, SweepAction.MILL
        sweeps = join_rows([sweeps, track, drum], SWEEP)
        moved = soil.step(
            tick, sweeps, deposit_requests if tick == 1 else empty_rows(DEPOSIT_REQUEST)
        )
        held.record_conversions(moved.conversions)
    soil.step(_TICKS + 1, empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST))
    soil.state_hash()
    _collapse_cliff(params)


def _collapse_cliff(params: SoilParams) -> None:
    """Let a cliff come down, which is swept, too."""
    heights = np.zeros((16, 16))
    heights[:8] = 8.0
    soil = Soil(Grid(16, 16, 0.2), heights, params)
    soil.relaxation.mark_all_disturbed()
    soil.relaxation.relax()
