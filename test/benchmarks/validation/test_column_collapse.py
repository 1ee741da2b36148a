"""Collapsing columns of soil have the runout of Lube et al."""

import pytest

from benchmarks.validation.column_collapse import (
    axisymmetric_law,
    collapse_axisymmetric,
    collapse_planar,
    planar_law,
)
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(tool_friction=17.0)
SHAPES = pytest.mark.parametrize("collapse", [collapse_axisymmetric, collapse_planar])


def test_laws_have_the_published_coefficients():
    # Lube et al. 2004: 1.24 a below a = 1.7, 1.6 sqrt(a) above; 2005: 1.2 a below 2.3, 1.9 a^(2/3).
    assert axisymmetric_law(1.0) == pytest.approx(1.24)
    assert axisymmetric_law(4.0) == pytest.approx(3.2)
    assert planar_law(1.0) == pytest.approx(1.2)
    assert planar_law(8.0) == pytest.approx(7.6)


@pytest.mark.parametrize(
    ("collapse", "law"),
    [(collapse_axisymmetric, axisymmetric_law), (collapse_planar, planar_law)],
)
def test_higher_column_has_a_longer_runout(collapse, law):
    low, high = collapse(SOIL, 0.7, 1000), collapse(SOIL, 3.0, 1000)
    assert low.aspect == pytest.approx(0.7, rel=0.15)
    assert high.aspect == pytest.approx(3.0, rel=0.15)
    for result in (low, high):
        assert result.expected_runout == pytest.approx(law(result.aspect))
        assert result.ratio == pytest.approx(result.runout / result.expected_runout)
        assert 1.0 < result.time < 15.0, "the soil came to rest"
    assert 0.3 < low.runout < 0.5 * high.runout


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.timeout(1200)
@SHAPES
@pytest.mark.parametrize("aspect", [1.0, 3.0])  # flatter columns need 100,000 particles
def test_runout_follows_the_law(collapse, aspect):
    result = collapse(SOIL, aspect, 20_000, capacity=20_000)
    assert result.aspect == pytest.approx(aspect, rel=0.05)
    assert result.ratio == pytest.approx(1.0, abs=0.15), result
