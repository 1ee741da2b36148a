"""The outflow of hoppers follows Beverloo's law."""

import math

import pytest

from benchmarks.validation import hopper_outflow
from benchmarks.validation.hopper_outflow import measure_outflow
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(tool_friction=17.0)


def make_flow(opening: float, rate: float) -> hopper_outflow.Flow:
    """Return a flow whose rate equals the expected rate."""
    return hopper_outflow.Flow(opening, rate, 0.0, 0.6, rate, 1, 0)


def test_exponent_of_a_power_law_is_its_slope():
    flows = [make_flow(d, 3.0 * (d - 1.4) ** 2.5) for d in (5.0, 8.0, 12.0)]
    assert hopper_outflow.flow_exponent(flows) == pytest.approx(2.5)
    assert flows[0].coefficient == pytest.approx(0.58)


def test_expected_rate_is_that_of_beverloo():
    # A particle is 0.6 L: d = (6 / pi * 0.6 L)^(1/3).
    d = (6.0 / math.pi * 0.6e-3) ** (1 / 3)
    flow = measure_outflow(SOIL, 6.0, 1900, passing=100)
    assert 0.55 < flow.packing < 0.64, "random packing of spheres, looser at the walls"
    density = flow.packing / 0.6e-3
    expected = 0.58 * density * math.sqrt(9.81) * ((6.0 - 1.4) * d) ** 2.5
    assert flow.expected_rate == pytest.approx(expected, rel=1e-3)


def test_larger_hole_has_more_outflow():
    small, large = (measure_outflow(SOIL, d, 1200, passing=200) for d in (5.0, 7.0))
    assert 2.0 < large.rate / small.rate < 4.5
    for flow in (small, large):
        assert 0.3 < flow.coefficient < 0.8
        assert flow.num_particles == 1200
        assert flow.num_tunnelled == 0


def test_jammed_bin_is_an_error():
    with pytest.raises(ValueError, match="jammed"):
        measure_outflow(SOIL, 2.0, 100, passing=100)


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.timeout(900)
def test_outflow_grows_with_the_effective_diameter_to_the_power_of_two_and_a_half():
    flows = [measure_outflow(SOIL, opening) for opening in hopper_outflow.OPENINGS]
    assert hopper_outflow.flow_exponent(flows) == pytest.approx(2.5, abs=0.15), flows
    for flow in flows:
        assert flow.rate == pytest.approx(flow.expected_rate, rel=0.25)
        assert flow.error < 0.05
        assert flow.num_tunnelled == 0
