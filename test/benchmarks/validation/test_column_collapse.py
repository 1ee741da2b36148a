"""Columns of soil that collapse run as far as Lube's."""

import math

import pytest

from benchmarks.validation import column_collapse
from msg_bridge.contract.loose_soil import LooseSoil

SOIL = LooseSoil(tool_friction=17.0)
SHAPES = pytest.mark.parametrize("shape", [column_collapse.axisymmetric, column_collapse.planar])


def axisymmetric_law(a: float) -> float:
    return 1.24 * a if a < 1.7 else 1.6 * math.sqrt(a)


def planar_law(a: float) -> float:
    return 1.2 * a if a < 2.3 else 1.9 * a ** (2 / 3)


@pytest.mark.parametrize(
    ("shape", "law"),
    [(column_collapse.axisymmetric, axisymmetric_law), (column_collapse.planar, planar_law)],
)
def test_a_higher_column_runs_farther(shape, law):
    flat, high = shape(SOIL, 0.7, 1000), shape(SOIL, 3.0, 1000)
    assert flat.aspect == pytest.approx(0.7, rel=0.15)
    assert high.aspect == pytest.approx(3.0, rel=0.15)
    for found in (flat, high):
        assert found.law == pytest.approx(law(found.aspect))
        assert found.ratio == pytest.approx(found.runout / found.law)
        assert 1.0 < found.time < 15.0, "it came to rest"
    assert 0.3 < flat.runout < 0.5 * high.runout


@pytest.mark.slow
@pytest.mark.timeout(1200)
@SHAPES
@pytest.mark.parametrize(
    ("aspect", "count"), [(0.5, 100_000), (1.0, 20_000), (2.0, 20_000), (3.0, 20_000)]
)
def test_runout_follows_the_law(shape, aspect, count):
    found = shape(SOIL, aspect, count, capacity=count)
    assert found.aspect == pytest.approx(aspect, rel=0.05)
    assert found.ratio == pytest.approx(1.0, abs=0.15), found
