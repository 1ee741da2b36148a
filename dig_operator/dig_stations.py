"""DigStations: the places that an excavator digs from, one behind the other.

The excavator digs out what is in reach, down to the depth of its behaviour, and drives backward
by one spacing, away from the crest of what it has dug::

      side view                  ___ machine, first station
        ____________________    |   |_
        |  bench  : cut :   \\___|_____|_
        |_________:_____:____\\  <---  spacing  --->  next station

A spacing shorter than the range of its reach leaves no ground standing between two cuts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dig_operator.track_drive import Line
from msg_bridge.contract.grid import Grid

__all__ = ["DigStations", "is_exhausted"]

_NUM_POOR_CYCLES = 2
"""Successive cycles that need several passes after which a place counts as exhausted."""

_MAP_MARGIN = 4.0
"""Distance of a station from the edge of the map [m]: half the length of a machine and more."""


def is_exhausted(
    plan_fraction: float, num_passes: Sequence[int], *, min_plan_fraction: float
) -> bool:
    """Return whether it is time to move on to the next station.

    Args:
        plan_fraction: volume that the next pass is planned to sweep, as a fraction of what it
            should; it falls where the ground in reach is dug out to the maximum depth.
        num_passes: number of passes of each cycle at this station.
        min_plan_fraction: fraction below which the station is exhausted.
    """
    last = num_passes[-_NUM_POOR_CYCLES:]
    is_poor = len(last) == _NUM_POOR_CYCLES and min(last) > 1
    return plan_fraction < min_plan_fraction or is_poor


@dataclass(frozen=True)
class DigStations:
    """Stations on a straight line, from the first one backward.

    Attributes:
        x, y: position of the first station [m], map frame.
        yaw: heading of the excavator [rad].
        spacing: distance between stations [m].
        count: number of stations.
    """

    x: float
    y: float
    yaw: float
    spacing: float
    count: int

    def position(self, number: int) -> tuple[float, float]:
        """Return the position of a station (x, y) [m], counted from 0."""
        distance = number * self.spacing
        return self.x - distance * math.cos(self.yaw), self.y - distance * math.sin(self.yaw)

    def exists(self, number: int, grid: Grid) -> bool:
        """Return whether there is a station of a number, counted from 0, and on the map."""
        x, y = self.position(number)
        half_x, half_y = (0.5 * size - _MAP_MARGIN for size in grid.size)
        return number < self.count and abs(x) <= half_x and abs(y) <= half_y

    def line_to(self, number: int) -> Line:
        """Return the line to reverse along to a station, counted from 0."""
        return Line(self.position(number), self.yaw + math.pi, is_reverse=True)
