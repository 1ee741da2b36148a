"""A plane blade that is dragged through level sand, and the force on it over its travel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["HEIGHT", "SPEED", "Blade", "Drag"]

HEIGHT = 0.6
"""Height of the blades above their edge [m]; no sand passes over them."""

SPEED = 0.3
"""Speed of the blades [m/s]; slow enough for inertia not to count."""


@dataclass(frozen=True)
class Blade:
    """A blade and its drag.

    Attributes:
        width: of the blade [m]; infinite if no soil passes beside it (plane strain).
        depth: of its edge below the surface [m].
        rake: of its face to the horizontal [deg]; below 90 it leans back.
        soil: name of the sand in `sands.yaml`.
    """

    width: float
    depth: float
    rake: float
    soil: str


@dataclass(frozen=True)
class Drag:
    """Force on a blade over its travel.

    Attributes:
        travel: [m], ascending, shape (n,).
        draft: force against the travel [N], of a blade of infinite width per metre, shape (n,).
        lift: upward force on the blade, in the same unit, shape (n,).
    """

    travel: NDArray[np.float64]
    draft: NDArray[np.float64]
    lift: NDArray[np.float64]

    def mean(self, low: float, high: float) -> tuple[float, float]:
        """Return the mean draft and lift over a range of the travel [m]."""
        within = (self.travel > low) & (self.travel <= high)
        return float(self.draft[within].mean()), float(self.lift[within].mean())
