"""Pairs of columns that are relaxed block by block, compared with NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from soil_sim.slope_failure.pair_blocks import BLOCK_SIZE, relax_block, steep_pairs

FIRST, PARTNER = 3, 40
"""Flat indices of the first columns of the pairs and of their partners."""
DISTANCE, TOLERANCE, FRACTION = np.float32(0.4), np.float32(0.01), np.float32(0.9)


@njit
def relax(heights, floor, tangents, selection):  # type: ignore[no-untyped-def]
    """Return the bits of the steep pairs, and of those of a selection between which soil moved."""
    x, y = np.uint64(FIRST), np.uint64(PARTNER)
    steep = steep_pairs(heights, tangents, x, y, DISTANCE, TOLERANCE)
    mask = np.uint16(steep & selection)
    return steep, relax_block(heights, floor, tangents, x, y, DISTANCE, FRACTION, mask)


@pytest.mark.parametrize("has_floor", [False, True])
@pytest.mark.parametrize("has_tangents", [False, True])
def test_selected_steep_pairs_give_a_fraction_of_their_excess(
    has_floor: bool, has_tangents: bool
) -> None:
    rng = np.random.default_rng(3)
    heights = rng.uniform(1.0, 2.5, 64).astype(np.float32)
    heights[FIRST + 4] = np.nan  # a wall
    floor = heights - rng.uniform(0.0, 0.3, 64).astype(np.float32)
    floor[FIRST + 5], floor[PARTNER + 5] = heights[FIRST + 5], heights[PARTNER + 5]
    tangents = rng.uniform(0.4, 0.9, 64).astype(np.float32)
    selection = 0b0111_1111_1011_1111
    selected = np.array([selection >> n & 1 for n in range(BLOCK_SIZE)], dtype=bool)

    x, y = slice(FIRST, FIRST + BLOCK_SIZE), slice(PARTNER, PARTNER + BLOCK_SIZE)
    drop = heights[x] - heights[y]
    tangent = np.where(drop > 0.0, tangents[x], tangents[y])
    excess = np.abs(drop) - (DISTANCE * tangent if has_tangents else DISTANCE)
    transfer = FRACTION * excess
    if has_floor:
        available = heights - floor
        transfer = np.minimum(transfer, np.where(drop > 0.0, available[x], available[y]))
    steep = excess > TOLERANCE
    transfer = np.where(steep & selected, transfer, np.float32(0.0))
    expected = heights.copy()
    expected[x] -= np.copysign(transfer, drop)
    expected[y] += np.copysign(transfer, drop)

    found, moved = relax(
        heights, floor if has_floor else None, tangents if has_tangents else None, selection
    )
    assert bits(found) == steep.tolist()
    assert bits(moved) == (transfer != 0.0).tolist()
    assert np.array_equal(heights, expected, equal_nan=True)
    assert 2 < np.count_nonzero(transfer) < np.count_nonzero(steep) < BLOCK_SIZE


def bits(mask: int) -> list[bool]:
    """Return whether each bit of a block is set."""
    return [bool(mask >> n & 1) for n in range(BLOCK_SIZE)]
