"""A drum that is not driven: the ground bears it, and it removes nothing."""

import numpy as np
from support.drum_scenes import drum_sweep

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, ConversionKind, SoilReaction, SweepAction
from msg_bridge.contract.rows import empty_rows as no_rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

GRID = Grid(65, 65, 0.1)
NOTHING = no_rows(DEPOSIT_REQUEST)


def test_bearing_force_hardly_depends_on_the_angle_of_the_drum():
    heights = np.where(GRID.x(np.arange(65))[:, None] > 0.45, 3.0, 0.0) * np.ones(GRID.shape)
    pushes = []
    for angle in (0.0, 0.26, 1.57, 3.1, 4.0):
        soil = Soil(GRID, heights, SoilParams(soil="loam"))
        at = (0.0, 0.0, 1.5)
        rows = drum_sweep(at, (0.02, 0.0, 1.5), action=SweepAction.COMPACT, angle=angle)
        forces = soil.step(1, rows, NOTHING).forces
        assert forces["fx"][forces["reaction"] == SoilReaction.CUT].tolist() == [0.0]
        pushes.append(float(forces["fx"][forces["reaction"] == SoilReaction.BEARING].sum()))
    assert max(pushes) < 0.0  # out of the wall
    assert min(pushes) > 2.5 * max(pushes)


def test_stationary_drum_compacts_and_excavates_nothing():
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams())
    at = (0.0, 0.0, 0.3)
    step = soil.step(1, drum_sweep(at, at, action=SweepAction.COMPACT), NOTHING)
    assert (step.conversions["kind"] != ConversionKind.EXCAVATE).all()
    assert step.rejected_tools == ()
