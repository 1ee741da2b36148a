"""A particle's volume goes to the four nearest columns, to the last cubic millimetre."""

import numpy as np
import pytest

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import CONVERSION, ConversionKind, empty_rows
from soil_sim.deposition import bilinear_shares

GRID = Grid(5, 4, 0.5)


def test_shares_are_bilinear_and_add_up() -> None:
    answers = empty_rows(CONVERSION, 1)
    answers["kind"], answers["volume_mm3"] = ConversionKind.DEPOSIT, 1001
    answers["x"], answers["y"] = GRID.x(1.25), GRID.y(2.5)
    answers["soil"], answers["moisture"] = 3, 40
    shares = bilinear_shares(GRID, answers)
    assert shares.cells.tolist() == [6, 7, 10, 11]
    assert shares.volume_mm3 == pytest.approx([375, 375, 125, 126], abs=1)
    assert shares.volume_mm3.sum() == 1001
    assert shares.soil.tolist() == [3] * 4
    assert shares.moisture.tolist() == [40] * 4


def test_only_what_came_down_on_the_map_is_shared_out() -> None:
    answers = empty_rows(CONVERSION, 4)
    answers["kind"] = (
        ConversionKind.OUTSIDE,
        ConversionKind.DEPOSIT,
        ConversionKind.REJECT,
        ConversionKind.DEPOSIT,
    )
    answers["volume_mm3"] = (1, 20, 300, 4000)
    shares = bilinear_shares(GRID, answers)
    assert shares.volume_mm3.reshape(-1, 4).sum(axis=1).tolist() == [20, 4000]


@pytest.mark.parametrize(("row", "col", "cell"), [(-0.4, -0.4, 0), (4.4, 3.4, 19)])
def test_beyond_the_outer_grid_points_all_goes_to_the_nearest(
    row: float, col: float, cell: int
) -> None:
    answers = empty_rows(CONVERSION, 1)
    answers["kind"], answers["volume_mm3"] = ConversionKind.DEPOSIT, 2**32 - 1
    answers["x"], answers["y"] = GRID.x(row), GRID.y(col)
    shares = bilinear_shares(GRID, answers)
    got = np.bincount(shares.cells, shares.volume_mm3)
    assert got[cell] == 2**32 - 1
