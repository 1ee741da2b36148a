"""The baseline of `benchmarks.soil_step_cost` does what the 2014 reference describes."""

import math

import numpy as np
import pytest

from benchmarks.reference_soil import ReferenceSoil
from msg_bridge.contract.grid import Grid
from soil_sim.errors import SoilError

TAN_30 = math.tan(math.radians(30.0))


def flat(n: int = 41, cell: float = 0.4, **options: float) -> ReferenceSoil:
    """Return level soil at height 0."""
    grid = Grid(n, n, cell)
    return ReferenceSoil(grid, np.zeros(grid.shape), **options)


def deposit(soil: ReferenceSoil, x: float, y: float, volume: float, times: int = 1) -> None:
    """Deposit a volume [m^3] some times at one position [m]."""
    soil.deposit(np.full(times, x), np.full(times, y), np.full(times, volume))


def trench(n: int = 61) -> ReferenceSoil:
    """Return a trench 2 m deep, 3 m wide and 6 m long, in cells of 0.2 m."""
    grid = Grid(n, n, 0.2)
    x, y = np.abs(grid.x(np.arange(n))), np.abs(grid.y(np.arange(n)))
    return ReferenceSoil(grid, np.where((x[:, None] < 3.0) & (y < 1.5), -2.0, 0.0))


@pytest.mark.parametrize(
    ("square", "count"),
    [(1, 4), (2, 8), (4, 12), (5, 20), (8, 24), (9, 28), (10, 36), (13, 44), (16, 48)],
)
def test_number_of_neighbours_is_that_of_the_gauss_circle(square: int, count: int) -> None:
    soil = flat(radius=math.sqrt(square))
    assert len(soil.offsets) == count
    assert (np.sum(soil.offsets**2, axis=1) <= square).all()


def test_deposit_is_distributed_bilinearly_to_the_four_nearest_points() -> None:
    soil = flat()
    deposit(soil, -0.1, -0.3, 0.016)  # a quarter and three quarters of a cell from the middle
    expected = np.zeros((41, 41))
    expected[20:22, 20:22] = 0.1 * np.array(
        [[0.75 * 0.25, 0.75 * 0.75], [0.25 * 0.25, 0.25 * 0.75]]
    )
    np.testing.assert_allclose(soil.height, expected, atol=1e-12)


def test_deposit_at_the_edge_of_the_outer_columns_stays_on_the_map() -> None:
    soil = flat()
    deposit(soil, 8.2, -8.2, 0.016)
    assert soil.height[0, 40] == pytest.approx(0.1)
    assert soil.volume == pytest.approx(0.016)


@pytest.mark.parametrize("angle", [30.0, 34.0])
def test_many_deposits_at_one_position_form_a_cone(angle: float) -> None:
    soil = flat(angle=math.radians(angle))
    deposit(soil, 0.1, 0.1, 0.01, times=4000)
    cone = (3 * 40.0 * math.tan(math.radians(angle)) ** 2 / math.pi) ** (1 / 3)
    assert soil.volume == pytest.approx(40.0, rel=1e-9)
    assert soil.height.max() == pytest.approx(cone, rel=0.05)
    assert soil.max_slope_excess() <= 1e-9


def test_only_the_deposit_moves_down_a_steep_face() -> None:
    soil = trench()
    before = soil.height.copy()
    deposit(soil, 0.0, 1.51, 0.001)
    assert (soil.height >= before).all()
    assert soil.volume == pytest.approx(before.sum() * 0.04 + 0.001, rel=1e-12)


def test_trench_collapses_until_no_slope_is_too_steep() -> None:
    soil = trench()
    before = soil.volume
    assert soil.max_slope_excess() == pytest.approx(2.0 - 0.2 * TAN_30)
    assert soil.collapse() > 1
    assert soil.max_slope_excess() <= 0.002 * 0.2
    assert soil.volume == pytest.approx(before, rel=1e-12)
    assert soil.height.min() > -2.0


def test_slope_below_the_critical_angle_is_stable() -> None:
    grid = Grid(33, 33, 0.2)
    heights = np.add.outer(grid.x(np.arange(33)), np.zeros(33)) * math.tan(math.radians(29.0))
    soil = ReferenceSoil(grid, heights)
    assert soil.collapse() == 1
    np.testing.assert_array_equal(soil.height, heights)


def test_column_at_the_corner_collapses_into_the_map() -> None:
    soil = flat(n=17, cell=0.2)
    soil.height[0, 0] = 1.0
    soil.collapse()
    assert soil.max_slope_excess() <= 0.002 * 0.2
    assert soil.volume == pytest.approx(0.04, rel=1e-12)


def test_digging_lowers_the_four_grid_points_around_each_bucket_point() -> None:
    soil = flat(n=21, cell=1.0)
    left, right = np.array([[0.5, 4.5, -0.2]]), np.array([[0.5, -4.5, -0.2]])
    volume = soil.dig(left, right)
    # Eight points from y = 3.5 to -3.5, a cell apart, between rows 9 and 10 and columns 6 to 14.
    expected = np.zeros((21, 21))
    expected[9:11, 6:15] = -0.2
    np.testing.assert_allclose(soil.height, expected)
    assert volume == pytest.approx(18 * 0.2)
    assert soil.dig(left, right) == 0.0


def test_bucket_in_the_air_or_off_the_map_excavates_nothing() -> None:
    soil = flat(n=21, cell=1.0)
    across = np.array([0.0, 2.0, 0.0])
    for middle in ([0.0, 0.0, 0.1], [50.0, 0.0, -1.0]):
        assert soil.dig(np.array([middle]) + across, np.array([middle]) - across) == 0.0
    assert not soil.height.any()


def test_invalid_deposit_is_an_error_and_changes_nothing() -> None:
    soil = flat()
    with pytest.raises(SoilError):
        deposit(soil, 100.0, 0.0, 0.01)
    with pytest.raises(SoilError):
        deposit(soil, 0.0, 0.0, math.nan)
    assert not soil.height.any()


def test_heights_of_another_shape_are_an_error() -> None:
    with pytest.raises(SoilError, match="shape"):
        ReferenceSoil(Grid(5, 5, 0.2), np.zeros((5, 4)))
