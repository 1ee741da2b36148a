"""TipArea: the places where a dumper tips its loads, in rows.

The rows are filled one after the other, the farthest first, and each from its first place on to the
left, so that no heap blocks the dumper::

      heading of the dumper ->          approach
        row 0     row 1     row 2          |
          o         o         o   <--------+  reverses to the place
          o         o         o            |
          o         o         o            |
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dig_operator.haul_params import HaulTaskParams
from msg_bridge.contract.grid import Grid

__all__ = ["Place", "TipArea"]

_MAP_MARGIN = 3.5
"""Distance of a place from the edge of the map [m]: half the dumper and what it tips behind it."""


class Place(NamedTuple):
    """A place to which a dumper reverses.

    Attributes:
        x, y: position [m], map frame.
        yaw: heading [rad].
        approach: distance over which it reverses to there [m].
    """

    x: float
    y: float
    yaw: float
    approach: float

    @property
    def approach_start(self) -> tuple[float, float]:
        """Where the approach starts (x, y) [m]."""
        return (
            self.x + self.approach * math.cos(self.yaw),
            self.y + self.approach * math.sin(self.yaw),
        )


class TipArea:
    """Places in rows. Places that, or whose approach, are off the map are left out."""

    def __init__(self, params: HaulTaskParams, grid: Grid) -> None:
        """
        Args:
            params: first place, number of rows and columns, and their spacings.
            grid: grid of the terrain.
        """
        places = (
            _place(params, row, column)
            for row in range(params.tip_rows)
            for column in range(params.tip_columns)
        )
        self._places = [place for place in places if _is_on_map(place, grid)]
        self.num_planned = params.tip_rows * params.tip_columns

    @property
    def num_places(self) -> int:
        """Number of places on the map."""
        return len(self._places)

    def place(self, number: int) -> Place | None:
        """Return the place for a load, counted from 0; None if the area is full."""
        return self._places[number] if number < len(self._places) else None


def _place(params: HaulTaskParams, row: int, column: int) -> Place:
    """Return a place; all rows are approached from one lane."""
    yaw = math.radians(params.tip_yaw)
    c, s = math.cos(yaw), math.sin(yaw)
    left, ahead = params.tip_spacing * column, params.tip_row_spacing * row
    return Place(
        params.tip_x + ahead * c - left * s,
        params.tip_y + ahead * s + left * c,
        yaw,
        params.tip_approach - ahead,
    )


def _is_on_map(place: Place, grid: Grid) -> bool:
    half_x, half_y = (0.5 * size - _MAP_MARGIN for size in grid.size)
    points = ((place.x, place.y), place.approach_start)
    return all(abs(x) <= half_x and abs(y) <= half_y for x, y in points)
