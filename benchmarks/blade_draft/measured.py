"""Measured draft forces of upright blades, and those of this project beside them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.blade_draft.blade import Blade
from benchmarks.blade_draft.drag import drag_blade

__all__ = ["SANDS", "BladeTest", "Draft", "read_tests", "simulate"]

SANDS = ("washed sand", "washed sand, 1 kPa")
"""The sand without cohesion, and with the intercept of its shear tests as cohesion."""

_MEASURED = Path(__file__).parents[2] / "validation" / "blade_draft.csv"
_RANGE = (0.5, 1.5)
"""Range of the travel over which the force is averaged [m]."""


@dataclass(frozen=True)
class BladeTest:
    """Tests of an upright blade at one depth.

    Attributes:
        width, depth: of the blade, and of its edge below the surface [m].
        force: mean of three tests [N].
        reading_error: error of the reading from the published figure [N].
    """

    width: float
    depth: float
    force: float
    reading_error: float


@dataclass(frozen=True)
class Draft:
    """Simulated force beside a test.

    Attributes:
        test: the test.
        forces: force on each grid [N], by the name of the sand.
    """

    test: BladeTest
    forces: dict[str, tuple[float, ...]]

    def ratio(self, sand: str) -> float:
        """Return the mean over the grids over the measured force."""
        return float(np.mean(self.forces[sand])) / self.test.force


def read_tests(path: Path = _MEASURED) -> list[BladeTest]:
    """Return the tests of a table.

    Raises:
        OSError: the table cannot be read.
    """
    table = np.genfromtxt(path, delimiter=",", names=True)
    columns = ("width_m", "depth_m", "force_n", "reading_error_n")
    return [BladeTest(*(float(row[name]) for name in columns)) for row in table]


def simulate(test: BladeTest, cells: tuple[float, ...]) -> Draft:
    """Drag the blade of a test through both sands, on a grid of each cell size [m]."""
    forces = {}
    for sand in SANDS:
        blade = Blade(test.width, test.depth, 90.0, sand)
        forces[sand] = tuple(drag_blade(blade, _RANGE[1], cell).mean(*_RANGE)[0] for cell in cells)
    return Draft(test, forces)
