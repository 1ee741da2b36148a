"""Ground and designs that tests of designs share."""

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid

GRID = Grid(40, 30, 0.2)


def level(grid: Grid = GRID, height: float = 0.0) -> NDArray[np.float64]:
    """Return heights of level ground [m]."""
    return np.full(grid.shape, height)


def pit() -> NDArray[np.float64]:
    """Return heights [m] of level ground with a pit 2 m x 3 m x 0.5 m."""
    heights = level()
    heights[10:20, 5:20] = -0.5
    return heights
