"""The outflow of hoppers follows Beverloo's law."""

import math

import pytest

from benchmarks.validation import hopper_outflow
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(tool_friction=17.0)


def flow(opening: float, rate: float) -> hopper_outflow.Flow:
    return hopper_outflow.Flow(opening, rate, 0.0, rate, 1, 0)


def test_the_slope_is_the_exponent_of_a_power_law():
    flows = [flow(wide, 3.0 * (wide - 1.4) ** 2.5) for wide in (5.0, 8.0, 12.0)]
    assert hopper_outflow.flow_exponent(flows) == pytest.approx(2.5)
    assert flows[0].coefficient == pytest.approx(0.58)


def test_the_law_is_beverloos():
    # A litre each, 0.60 of the room filled: (6 / pi * 0.6 l)^(1/3) wide.
    d = (6.0 / math.pi * 0.6e-3) ** (1 / 3)
    found = hopper_outflow.outflow(SOIL, 6.0, 700, passing=100)
    expected = 0.58 * 1e3 * math.sqrt(9.81) * ((6.0 - 1.4) * d) ** 2.5
    assert found.law == pytest.approx(expected, rel=1e-3)


def test_more_flows_through_a_larger_hole():
    small, large = (hopper_outflow.outflow(SOIL, wide, 1200, passing=200) for wide in (5.0, 7.0))
    assert 2.0 < large.rate / small.rate < 4.5
    for found in (small, large):
        assert 0.3 < found.coefficient < 0.8
        assert found.particles == 1200
        assert found.tunnelled == 0


def test_a_bin_that_does_not_flow_is_told():
    with pytest.raises(ValueError, match="jams"):
        hopper_outflow.outflow(SOIL, 2.0, 100, passing=100)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_outflow_goes_with_the_width_to_the_power_of_two_and_a_half():
    flows = hopper_outflow.outflows(SOIL)
    assert hopper_outflow.flow_exponent(flows) == pytest.approx(2.5, abs=0.1), flows
    for found in flows:
        assert found.rate == pytest.approx(found.law, rel=0.25)
        assert found.error < 0.05
        assert found.tunnelled == 0
