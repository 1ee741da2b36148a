"""Force on steep and rough faces: Sokolovskii's limit state, and its ratio to plane failure."""

import math

import pytest
from support.limit_state import curved_failure_ratio, exact_resistance

from msg_bridge.kernels import kernel
from soil_sim.tool_force.curved_failure import curved_failure_factor


@kernel
def factor(rake, phi, delta):
    return curved_failure_factor(math.radians(rake), math.radians(phi), math.radians(delta))


@pytest.mark.parametrize(
    ("phi", "delta", "passive"),
    [
        (10, 5, 1.55), (10, 10, 1.66), (20, 10, 2.55), (20, 20, 3.04), (30, 15, 4.62),
        (30, 30, 6.55), (40, 20, 9.69), (40, 40, 18.2),
    ],
)  # fmt: skip
def test_reference_has_the_pressures_of_the_table_of_sokolovskii(phi, delta, passive) -> None:
    """Statics of Granular Media, 1965: vertical wall, level surface."""
    found = exact_resistance(*(math.radians(angle) for angle in (90, phi, delta)))
    assert found == pytest.approx(passive, rel=0.01)


CASES = [
    (rake, phi, roughness * phi)
    for phi in (12.0, 25.0, 35.0, 45.0)
    for roughness in (0.0, 0.5, 0.7, 1.0)
    for rake in (60.0, 75.0, 90.0, 105.0, 125.0)
    if rake + phi + roughness * phi <= 160.0  # the limit of the trial wedge
]


@pytest.mark.parametrize(("rake", "phi", "delta"), CASES)
def test_factor_is_that_of_the_limit_state(rake, phi, delta) -> None:
    exact = curved_failure_ratio(*(math.radians(angle) for angle in (rake, phi, delta)))
    assert factor(rake, phi, delta) == pytest.approx(exact, rel=0.04)


def test_factor_is_one_where_plane_failure_is_exact_and_continuous_there() -> None:
    assert factor(90.0, 30.0, 0.0) == 1.0  # Rankine
    assert factor(60.0, 34.0, 20.0) == 1.0
    assert factor(90.0, 0.0, 0.0) == 1.0
    assert factor(30.0, 35.0, 30.0) == 1.0
    assert factor(90.5, 30.0, 0.0) == pytest.approx(1.0, abs=1e-3)
    assert math.isfinite(factor(180.0, 60.0, 60.0))


def test_angles_are_clamped_as_those_of_the_wedge() -> None:
    assert factor(80.0, 30.0, 50.0) == factor(80.0, 30.0, 30.0)
    assert factor(170.0, 40.0, 20.0) == factor(100.0, 40.0, 20.0)
