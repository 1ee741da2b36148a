"""TipArea: rows and columns of places, and those that are on the map."""

from __future__ import annotations

import math

import pytest

from dig_operator.haul_params import HaulTaskParams
from dig_operator.tip_area import TipArea
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid

MAP = Grid(257, 257, 0.2)  # 51 m


def area(**params: float) -> TipArea:
    defaults = {"tip_x": -10.0, "tip_y": 12.0, "tip_yaw": -90.0, "tip_approach": 12.0}
    return TipArea(HaulTaskParams.from_mapping({**defaults, **params}), MAP)


def places(tip_area: TipArea) -> list[tuple[float, float]]:
    found = (tip_area.place(k) for k in range(tip_area.num_places))
    return [(round(place.x, 6), round(place.y, 6)) for place in found if place is not None]


def test_a_new_row_begins_before_the_first_when_one_is_full() -> None:
    grid = area(tip_columns=3, tip_rows=2, tip_spacing=4.0, tip_row_spacing=5.0)
    # Left of the heading -90 deg is +x, forward is -y.
    assert places(grid) == [(-10, 12), (-6, 12), (-2, 12), (-10, 7), (-6, 7), (-2, 7)]


def test_all_rows_are_approached_from_one_lane() -> None:
    grid = area(tip_columns=1, tip_rows=3, tip_row_spacing=5.0)
    starts = [place.approach_start for k in range(3) if (place := grid.place(k)) is not None]
    assert starts == [pytest.approx((-10.0, 0.0))] * 3


def test_area_is_full_after_its_last_place() -> None:
    grid = area(tip_columns=2, tip_rows=2)
    assert grid.place(3) is not None
    assert grid.place(4) is None


def test_places_off_the_map_are_left_out() -> None:
    grid = area(tip_columns=12, tip_spacing=4.0)
    assert grid.num_places == 9  # x from -10 to 22 m
    assert grid.num_planned == 12
    assert max(x for x, _ in places(grid)) == pytest.approx(22.0)
    assert area(tip_y=30.0).num_places == 0
    assert area(tip_approach=40.0).num_places == 0, "the lane is off the map"


def test_heading_is_that_of_the_parameter() -> None:
    place = area().place(0)
    assert place is not None
    assert place.yaw == pytest.approx(-0.5 * math.pi)


def test_loads_must_have_a_place_unless_the_duration_ends_them() -> None:
    with pytest.raises(ParameterError, match=r"7.*6 places.*tip_rows"):
        area(loads=7, tip_columns=3, tip_rows=2)
    assert area(loads=7, tip_columns=3, tip_rows=2, duration=60.0).num_planned == 6


def test_rows_must_fit_into_the_approach() -> None:
    with pytest.raises(ParameterError, match="approach"):
        area(tip_rows=4, tip_row_spacing=5.0)
