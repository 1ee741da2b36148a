"""Planning a dig: where the lip should go so that the bucket comes out full.

Everything is in the arm's plane: radius r from the swing axis and height z. The lip enters far out,
is dragged toward the machine at a depth below the surface seen there, and comes up again::

        surface  ----+\\                         /+----
                       \\_______________________/
              r_near   <------- drag ---------   r_far
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["DigPlan", "DigReach", "plan_dig"]


@dataclass(frozen=True)
class DigReach:
    """Where a bucket can dig.

    Attributes:
        near, far: smallest and largest radius of the lip [m].
        lowest: lowest height of the lip [m], map frame.
        width: of the bucket [m].
        deepest_cut: most soil the lip goes under in one pass [m].
    """

    min_radius: float
    max_radius: float
    min_height: float
    width: float
    max_cut_depth: float


@dataclass(frozen=True)
class DigPlan:
    """The lip's way through the soil.

    Attributes:
        radius, height: way points from entry to exit [m], shape (n,).
        volume: soil swept [m^3].
    """

    radius: NDArray[np.float64]
    height: NDArray[np.float64]
    volume: float

    @classmethod
    def without_waypoints(cls) -> DigPlan:
        """A plan without way points, before the first."""
        return cls(np.zeros(0), np.zeros(0), 0.0)


_WAYPOINT_SPACING = 0.1
_DRAG_LENGTH = 3.0
"""Length of a drag [m], where there is room for it."""

_ENTRY_FRACTION, _EXIT_FRACTION = 0.25, 0.2
"""Parts of the drag in which the lip goes down and comes up."""


def plan_dig(
    radius: NDArray[np.float64], surface: NDArray[np.float64], reach: DigReach, volume: float
) -> DigPlan:
    """Plan a pass that sweeps `volume` [m^3], as near to it as the reach allows.

    The entry is put where the soil is highest: there it takes the least depth below the rim.

    Args:
        radius, surface: terrain along the arm's plane [m], radius ascending, shape (n,).
        reach: of the machine.
        volume: of soil wanted in the bucket.
    """
    first = min(reach.min_radius + 0.5 * _DRAG_LENGTH, reach.max_radius)
    starts = np.arange(first, reach.max_radius + 1e-9, 0.25)
    plans = [_plan_pass(start, radius, surface, reach, volume) for start in starts]
    # Enough soil first; among those, the way that lies highest: pits grow wide before deep.
    return max(plans, key=lambda p: (min(p.volume, 0.95 * volume), float(p.height.mean())))


def _plan_pass(
    start: float,
    radius: NDArray[np.float64],
    surface: NDArray[np.float64],
    reach: DigReach,
    volume: float,
) -> DigPlan:
    end = max(start - _DRAG_LENGTH, reach.min_radius)
    r = np.linspace(start, end, max(int((start - end) / _WAYPOINT_SPACING), 4) + 1)
    part = (start - r) / (start - end)
    shape = np.clip(np.minimum(part / _ENTRY_FRACTION, (1.0 - part) / _EXIT_FRACTION), 0.0, 1.0)
    ground = np.interp(r, radius, surface)
    step = np.abs(np.gradient(r))

    def swept(depth: float) -> tuple[NDArray[np.float64], float]:
        z = np.maximum(ground - depth * shape, np.minimum(ground, reach.min_height))
        return z, float(((ground - z) * step).sum() * reach.width)

    depth = reach.max_cut_depth
    for trial in np.linspace(0.05, reach.max_cut_depth, 40):
        if swept(trial)[1] >= volume:
            depth = float(trial)
            break
    z, got = swept(depth)
    return DigPlan(r, z, got)
