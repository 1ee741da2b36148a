"""Performance of the shipped machines beside published figures of real ones."""

import pytest
from support.machine_scenes import excavator, load_shipped_machine

from earthmoving_sim.machine_performance import machine_figures

TIME_TOLERANCE = 0.3
"""Tolerance that the service manual gives with the times of cylinders [s]."""


@pytest.fixture(scope="module")
def figures():
    return machine_figures(excavator())


@pytest.mark.parametrize("reference", excavator().references, ids=lambda each: each.name)
def test_excavator_is_within_10_percent_of_published_figures(figures, reference):
    assert_within_10_percent(figures, reference)


def assert_within_10_percent(figures, reference):
    for name, published in reference.figures.items():
        tolerance = TIME_TOLERANCE if name.endswith("_time") else 0.0
        assert figures[name] == pytest.approx(published, rel=0.1, abs=tolerance), name


def test_figures_of_a_machine_without_an_excavator_arm():
    dumper = load_shipped_machine("dumper")
    figures = machine_figures(dumper)
    assert "swing_torque" not in figures
    assert figures["operating_mass"] == dumper.mass
    assert figures["travel_speed"] == pytest.approx(3.6 * dumper.tracks.max_speed, rel=0.05)
    for reference in dumper.references:
        assert_within_10_percent(figures, reference)
