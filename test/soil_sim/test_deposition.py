"""The volume of a particle goes to the four nearest columns, exactly."""

import numpy as np
import pytest

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import CONVERSION, ConversionKind, empty_rows
from soil_sim.columns.grid_frame import grid_frame
from soil_sim.deposition import bilinear_shares

GRID = Grid(5, 4, 0.5)


def test_shares_are_bilinear_and_add_up() -> None:
    conversions = empty_rows(CONVERSION, 1)
    conversions["kind"], conversions["volume_mm3"] = ConversionKind.DEPOSIT, 1001
    conversions["x"], conversions["y"] = GRID.x(1.25), GRID.y(2.5)
    conversions["soil"], conversions["moisture"] = 3, 40
    shares = bilinear_shares(grid_frame(GRID), conversions)
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
    shares = bilinear_shares(grid_frame(GRID), conversions)
    assert shares.volume_mm3.reshape(-1, 4).sum(axis=1).tolist() == [20, 4000]


@pytest.mark.parametrize(("row", "col", "cell"), [(-0.4, -0.4, 0), (4.4, 3.4, 19)])
def test_deposits_beyond_the_outer_grid_points_go_to_the_nearest_column(
    row: float, col: float, cell: int
) -> None:
    conversions = empty_rows(CONVERSION, 1)
    conversions["kind"], conversions["volume_mm3"] = ConversionKind.DEPOSIT, 2**32 - 1
    conversions["x"], conversions["y"] = GRID.x(row), GRID.y(col)
    shares = bilinear_shares(grid_frame(GRID), conversions)
    received = np.bincount(shares.cells, shares.volume_mm3)
    assert received[cell] == 2**32 - 1
