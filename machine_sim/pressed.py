"""How far the ground was pressed: what a machine's copy of the terrain remembers of its tracks.

A track is borne by the depth it is below the ground as it was before tracks came. The soil tells
where that ground is now, not why: a column that fell was pressed, dug, or slid away. Its volume
tells them apart, as pressing moves none. What tracks pressed they press no further when they come
again; soil that comes or goes makes the ground forget as much of it.
"""

from __future__ import annotations

from types import EllipsisType

import numpy as np
from numpy.typing import NDArray

__all__ = ["At", "Pressed"]

_NOTHING = 1e-4
"""Less than this [m] is what messages round."""

At = tuple[NDArray[np.integer], NDArray[np.integer]] | EllipsisType
"""Rows and columns, or all of them."""


class Pressed:
    """The memory of each column.

    Attributes:
        packed: how far its surface was pressed below where it would be [m], shape (rows, cols).
        sunk: how far a sole was below that, at least `packed` [m], likewise; soles write it.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        """`shape` of the terrain: rows, cols."""
        self.packed: NDArray[np.float64] = np.zeros(shape)
        self.sunk: NDArray[np.float64] = np.zeros(shape)

    def follow(
        self, at: At, rise: NDArray[np.float64], moved: NDArray[np.float64], growth: float
    ) -> None:
        """Follow columns that changed.

        Args:
            at: their rows and columns, or all.
            rise: of their surface [m].
            moved: bank volume that came, below 0 what went, as a height [m]; NaN if not known.
            growth: room that loose soil takes at most, over its bank volume.
        """
        # Soil that goes takes at most the room of loose soil with it, and brings at least its own.
        explained = np.fmax(rise, moved * np.where(moved < 0.0, growth, 1.0))
        pressed = explained - rise
        pressed[pressed < _NOTHING] = 0.0
        forgotten = np.abs(explained)
        self.packed[at] = np.maximum(self.packed[at] - forgotten, 0.0) + pressed
        self.sunk[at] = np.maximum(self.sunk[at] - forgotten, self.packed[at])
