"""Division of a grid into slabs of rows, each of which is owned by one region."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid

__all__ = ["Slab", "split_into_slabs"]


class Slab(NamedTuple):
    """Rows of a region, as indices of the whole grid.

    Attributes:
        first, end: first row that it owns, and the row after the last.
        low, high: first row that it holds, its halo included, and the row after the last.
    """

    first: int
    end: int
    low: int
    high: int


def split_into_slabs(grid: Grid, num_regions: int, halo: int) -> list[Slab]:
    """Divide the rows of a grid equally.

    Args:
        grid: the whole grid.
        num_regions: number of slabs.
        halo: number of rows of its neighbours that a region also holds.

    Raises:
        ParameterError: a slab would be narrower than its halo, which would then reach beyond its
            neighbour.
    """
    if num_regions < 1 or halo < 1:
        raise ParameterError(
            f"{num_regions} regions with a halo of {halo} rows; give at least 1 of both"
        )
    borders = [round(n * grid.rows / num_regions) for n in range(num_regions + 1)]
    slabs = [
        Slab(first, end, max(first - halo, 0), min(end + halo, grid.rows))
        for first, end in pairwise(borders)
    ]
    narrowest = min(slab.end - slab.first for slab in slabs)
    if num_regions > 1 and narrowest < halo:
        raise ParameterError(
            f"a region has {narrowest} of {grid.rows} rows and a halo of {halo}; split into fewer"
            " regions, or reduce the halo"
        )
    return slabs
