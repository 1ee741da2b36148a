"""Plan of a dig: a path of the lip that fills the bucket.

The plan lies in the plane of the arm: radius r from the swing axis and height z. The lip enters at
the far end, is dragged toward the machine at a constant depth below the observed surface, and
comes up again::

        surface  ----+\\                         /+----
                       \\_______________________/
            min_radius   <------- drag ---------   max_radius
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["DigPlan", "DigReach", "plan_dig"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DigReach:
    """Region in which a bucket can dig.

    Attributes:
        min_radius: smallest radius of the lip [m].
        max_radius: largest radius of the lip [m].
        min_height: lowest height of the lip [m], map frame.
        width: width of the bucket [m].
        max_cut_depth: maximum depth of the lip below the surface in one pass [m].
    """

    min_radius: float
    max_radius: float
    min_height: float
    width: float
    max_cut_depth: float


@dataclass(frozen=True)
class DigPlan:
    """Path of the lip through the soil.

    Attributes:
        radius: radius of each waypoint, from entry to exit [m], shape (n,).
        height: height of each waypoint, from entry to exit [m], shape (n,).
        volume: volume of soil swept [m^3].
    """

    radius: Array
    height: Array
    volume: float

    @classmethod
    def without_waypoints(cls) -> DigPlan:
        """Return an empty plan."""
        return cls(np.zeros(0), np.zeros(0), 0.0)


_WAYPOINT_SPACING = 0.1
"""Distance between waypoints [m]."""

_DRAG_LENGTH = 3.0
"""Length of a drag [m], unless the reach is shorter."""

_START_SPACING = 0.25
"""Distance between the entry points that are compared [m]."""

_ENTRY_FRACTION, _EXIT_FRACTION = 0.25, 0.2
"""Fractions of the drag in which the lip goes down and comes up."""

_MIN_TRIAL_DEPTH, _NUM_TRIAL_DEPTHS = 0.05, 40
"""Smallest depth that is tried [m], and the number of depths from there to max_cut_depth."""

_ENOUGH_VOLUME_FRACTION = 0.95
"""Fraction of the requested volume from which on plans are compared by height only."""


def plan_dig(radius: Array, surface: Array, reach: DigReach, volume: float) -> DigPlan:
    """Plan a pass that sweeps `volume` [m^3], or as much of it as the reach allows.

    The entry is put where the soil is highest: a pit then grows wide before it grows deep.

    Args:
        radius: radii of the terrain profile in the plane of the arm, ascending [m], shape (n,).
        surface: height of the terrain at these radii [m], shape (n,).
        reach: region in which the bucket can dig.
        volume: volume of soil to sweep [m^3].
    """
    first_start = min(reach.min_radius + 0.5 * _DRAG_LENGTH, reach.max_radius)
    starts = np.arange(first_start, reach.max_radius + 1e-9, _START_SPACING)
    plans = [_plan_pass(start, radius, surface, reach, volume) for start in starts]
    enough = _ENOUGH_VOLUME_FRACTION * volume
    return max(plans, key=lambda plan: (min(plan.volume, enough), float(plan.height.mean())))


def _plan_pass(
    start: float, radius: Array, surface: Array, reach: DigReach, volume: float
) -> DigPlan:
    """Plan a pass from the radius `start` [m] with the smallest depth that sweeps the volume."""
    end = max(start - _DRAG_LENGTH, reach.min_radius)
    r = np.linspace(start, end, max(int((start - end) / _WAYPOINT_SPACING), 4) + 1)
    fraction = (start - r) / (start - end)
    depth_profile = np.clip(
        np.minimum(fraction / _ENTRY_FRACTION, (1.0 - fraction) / _EXIT_FRACTION), 0.0, 1.0
    )
    ground = np.interp(r, radius, surface)
    spacing = np.abs(np.gradient(r))

    def sweep(depth: float) -> tuple[Array, float]:
        """Return the lip's heights [m] and the swept volume [m^3] for a depth [m]."""
        z = np.maximum(ground - depth * depth_profile, np.minimum(ground, reach.min_height))
        return z, float(((ground - z) * spacing).sum() * reach.width)

    depth = reach.max_cut_depth
    for trial in np.linspace(_MIN_TRIAL_DEPTH, reach.max_cut_depth, _NUM_TRIAL_DEPTHS):
        if sweep(trial)[1] >= volume:
            depth = float(trial)
            break
    height, swept_volume = sweep(depth)
    return DigPlan(r, height, swept_volume)
