"""Cycles are found by the payload alone."""

from __future__ import annotations

import pytest

from earthmoving_sim.run_figures.payload_cycles import find_cycles

DIG = [(0.0, 0.0), (4.0, 0.5), (6.0, 1.0), (9.0, 0.9), (10.0, 0.1)]
"""Time [s] and payload [m^3] of a cycle that spills on the way and keeps some soil."""


def shifted(start: float) -> list[tuple[float, float]]:
    return [(start + time, volume) for time, volume in DIG]


def test_volume_is_the_peak_minus_what_remains() -> None:
    first, second = find_cycles(DIG + shifted(20.0))
    assert first == pytest.approx((10.0, 0.9, 10.0))
    assert second == pytest.approx((30.0, 0.9, 20.0))


@pytest.mark.parametrize("samples", [[], [(0.0, 0.0), (1.0, 0.0)], DIG[:4]])
def test_no_cycle_before_it_is_complete(samples: list[tuple[float, float]]) -> None:
    assert find_cycles(samples) == []


def test_soil_that_sticks_is_no_load() -> None:
    samples = [*DIG, (12.0, 0.2), (13.0, 0.1), *shifted(20.0)]
    assert len(find_cycles(samples)) == 2
