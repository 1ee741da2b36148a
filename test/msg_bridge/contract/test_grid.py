import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid


def test_index_zero_is_the_corner_at_plus_x_plus_y() -> None:
    grid = Grid(5, 3, 0.5)
    assert grid.x(0) == pytest.approx(1.0)
    assert grid.x(4) == pytest.approx(-1.0)
    assert grid.y(0) == pytest.approx(0.5)
    assert grid.y(2) == pytest.approx(-0.5)


def test_map_width_is_the_number_of_columns_times_the_spacing() -> None:
    grid = Grid(5, 3, 0.5)
    assert grid.size == (2.5, 1.5)
    assert grid.contains([1.25, 1.26], [0.0, 0.0]).tolist() == [True, False]
    assert grid.contains([0.0, 0.0], [-0.75, -0.76]).tolist() == [True, False]


@given(st.integers(2, 500), st.integers(2, 500), st.floats(0.01, 10.0), st.floats(0, 499))
def test_rows_and_x_are_inverse(rows: int, cols: int, cell: float, index: float) -> None:
    grid = Grid(rows, cols, cell)
    assert grid.row(grid.x(index)) == pytest.approx(index, abs=1e-9)
    assert grid.col(grid.y(index)) == pytest.approx(index, abs=1e-9)


@pytest.mark.parametrize("cell", [0.0, -1.0, np.nan, np.inf])
def test_invalid_spacing_is_rejected(cell: float) -> None:
    with pytest.raises(ParameterError, match="spacing"):
        Grid(5, 5, cell)


def test_grid_of_one_column_is_rejected() -> None:
    with pytest.raises(ParameterError, match="at least 2 x 2"):
        Grid(1, 5, 0.5)


def test_spacing_given_as_an_integer_is_a_float() -> None:
    """Kernels that have run with a float would read the bits of an integer as one."""
    assert isinstance(Grid(5, 5, 1).cell, float)
