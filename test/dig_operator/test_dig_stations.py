"""DigStations: where the stations are, which are on the map, and when one is exhausted."""

from __future__ import annotations

import math

import pytest

from dig_operator.dig_stations import DigStations, is_exhausted
from msg_bridge.contract.grid import Grid

MAP = Grid(121, 121, 0.2)  # 24 m


def test_stations_lie_behind_one_another() -> None:
    stations = DigStations(1.0, 2.0, 0.5 * math.pi, spacing=2.5, count=3)
    assert stations.position(0) == pytest.approx((1.0, 2.0))
    assert stations.position(2) == pytest.approx((1.0, -3.0))


def test_machine_reverses_to_a_station_along_their_line() -> None:
    line = DigStations(0.0, 0.0, 0.3, spacing=2.0, count=2).line_to(1)
    assert line.is_reverse
    assert line.end == pytest.approx((-2.0 * math.cos(0.3), -2.0 * math.sin(0.3)))
    assert math.remainder(line.course - math.pi - 0.3, 2 * math.pi) == pytest.approx(0.0)


def test_there_are_as_many_stations_as_counted_and_lie_on_the_map() -> None:
    stations = DigStations(0.0, 0.0, 0.0, spacing=3.0, count=3)
    assert [stations.exists(k, MAP) for k in range(4)] == [True, True, True, False]
    farther = DigStations(-4.0, 0.0, 0.0, spacing=3.0, count=9)
    assert [farther.exists(k, MAP) for k in range(4)] == [True, True, False, False]


@pytest.mark.parametrize(
    ("plan_fraction", "num_passes", "expected"),
    [
        (1.0, [], False),
        (0.8, [1, 1], False),
        (0.7, [1, 1], True),  # dug out
        (1.0, [2], False),  # one poor cycle
        (1.0, [2, 1], False),
        (1.0, [1, 2, 3], True),  # two in succession
    ],
)
def test_station_is_exhausted_with_little_ground_or_after_poor_cycles(
    plan_fraction: float, num_passes: list[int], expected: bool
) -> None:
    assert is_exhausted(plan_fraction, num_passes, min_plan_fraction=0.75) is expected
