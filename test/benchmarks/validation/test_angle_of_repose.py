"""A poured heap has the angle of repose of its soil."""

import math

import numpy as np
import pytest

from benchmarks.validation.angle_of_repose import poured_repose_angle
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.soils.soil_types import load_soil_types


def test_larger_repose_angle_gives_a_steeper_heap():
    flat, steep = (
        poured_repose_angle(LooseSoil(repose_angles=(a, a, a)), 400) for a in (20.0, 40.0)
    )
    assert 10.0 < flat < steep - 5.0 < 40.0


def test_moisture_changes_the_angle_of_the_heap():
    soil = LooseSoil(repose_angles=(40.0, 30.0, 20.0))
    assert poured_repose_angle(soil, 400, moisture=100) < poured_repose_angle(soil, 400) - 5.0


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.parametrize("name", sorted(load_soil_types()))
def test_poured_heap_has_the_repose_angle_of_its_soil(name):
    soil_type = load_soil_types()[name]
    expected = math.degrees(soil_type.repose_angle_at(soil_type.moisture))
    # The angle of a single heap of 2000 particles scatters by about one degree.
    angles = [
        poured_repose_angle(soil_type.loose_soil, 2000, rate=rate, moisture=soil_type.moisture)
        for rate in (200.0, 180.0, 160.0)
    ]
    if name == "wet clay":  # its lumps stick together; the heap flattens when it becomes terrain
        assert expected + 10.0 < np.mean(angles) < 45.0
    else:
        assert np.mean(angles) == pytest.approx(expected, abs=2.0)
