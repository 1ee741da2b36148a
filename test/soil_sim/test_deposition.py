"""The volume of a particle goes to the four nearest columns, exactly."""

import numpy as np
import pytest

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import CONVERSION, ConversionKind, Rows, empty_rows
from soil_sim.columns.grid_frame import grid_frame
from soil_sim.columns.occupancy import TOOL_INSIDE
from soil_sim.deposition import bilinear_shares

GRID = Grid(5, 4, 0.5)
NO_TOOLS = np.zeros(GRID.shape, dtype=np.uint8)


def deposit_at(row: float, col: float, volume_mm3: int) -> Rows:
    """Return a row of a particle deposited at a fractional row and column."""
    conversions = empty_rows(CONVERSION, 1)
    conversions["kind"], conversions["volume_mm3"] = ConversionKind.DEPOSIT, volume_mm3
    conversions["x"], conversions["y"] = GRID.x(row), GRID.y(col)
    return conversions


def test_shares_are_bilinear_and_add_up() -> None:
    conversions = deposit_at(1.25, 2.5, 1001)
    conversions["soil"], conversions["moisture"] = 3, 40
    shares = bilinear_shares(grid_frame(GRID), conversions, NO_TOOLS)
    assert shares.cells.tolist() == [6, 7, 10, 11]
    assert shares.volume_mm3 == pytest.approx([375, 375, 125, 126], abs=1)
    assert shares.volume_mm3.sum() == 1001
    assert shares.soil.tolist() == [3] * 4
    assert shares.moisture.tolist() == [40] * 4


def test_only_deposits_are_distributed() -> None:
    conversions = empty_rows(CONVERSION, 4)
    conversions["kind"] = (
        ConversionKind.OUTSIDE,
        ConversionKind.DEPOSIT,
        ConversionKind.REJECT,
        ConversionKind.DEPOSIT,
    )
    conversions["volume_mm3"] = (1, 20, 300, 4000)
    shares = bilinear_shares(grid_frame(GRID), conversions, NO_TOOLS)
    assert shares.volume_mm3.reshape(-1, 4).sum(axis=1).tolist() == [20, 4000]


@pytest.mark.parametrize(("row", "col", "cell"), [(-0.4, -0.4, 0), (4.4, 3.4, 19)])
def test_deposits_beyond_the_outer_grid_points_go_to_the_nearest_column(
    row: float, col: float, cell: int
) -> None:
    shares = bilinear_shares(grid_frame(GRID), deposit_at(row, col, 2**32 - 1), NO_TOOLS)
    received = np.bincount(shares.cells, shares.volume_mm3)
    assert received[cell] == 2**32 - 1


def test_columns_that_a_tool_is_in_get_no_share() -> None:
    occupied = NO_TOOLS.copy()
    occupied[1, 2:] = TOOL_INSIDE
    shares = bilinear_shares(grid_frame(GRID), deposit_at(1.25, 2.5, 1001), occupied)
    received = np.bincount(shares.cells, shares.volume_mm3, minlength=GRID.rows * GRID.cols)
    assert received.sum() == 1001
    assert received.reshape(GRID.shape)[2, 2:] == pytest.approx([500, 501], abs=1)


@pytest.mark.parametrize(("row", "free_row"), [(1.25, 0), (2.75, 4)])
def test_particle_among_columns_with_a_tool_goes_to_the_nearest_other_column(
    row: float, free_row: int
) -> None:
    occupied = NO_TOOLS.copy()
    occupied[1:4] = TOOL_INSIDE
    shares = bilinear_shares(grid_frame(GRID), deposit_at(row, 1.25, 1001), occupied)
    received = np.bincount(shares.cells, shares.volume_mm3, minlength=GRID.rows * GRID.cols)
    assert received.reshape(GRID.shape)[free_row, 1] == 1001
