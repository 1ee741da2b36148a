"""A poured heap has the angle that its soil asks for."""

import math

import numpy as np
import pytest

from benchmarks.validation.angle_of_repose import poured_repose_angle
from msg_bridge.contract.loose_soil import LooseSoil
from soil_sim.soils.soil_types import load_soil_types


def test_a_steeper_soil_pours_a_steeper_heap():
    flat, steep = (
        poured_repose_angle(LooseSoil(repose_angles=(a, a, a)), 400) for a in (20.0, 40.0)
    )
    assert 10.0 < flat < steep - 5.0 < 40.0


def test_moisture_counts():
    soil = LooseSoil(repose_angles=(40.0, 30.0, 20.0))
    assert poured_repose_angle(soil, 400, moisture=100) < poured_repose_angle(soil, 400) - 5.0


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(load_soil_types()))
def test_a_heap_pours_to_the_angle_of_its_soil(name):
    kind = load_soil_types()[name]
    asked = math.degrees(kind.repose_angle_at(kind.moisture))
    # One pour of some thousands is off by a degree, this way or that.
    pours = [
        poured_repose_angle(kind.loose_soil, 2000, rate=rate, moisture=kind.moisture)
        for rate in (200.0, 180.0, 160.0)
    ]
    # Lumps of wet clay stick: nothing that does pours flatter than about 16 degrees.
    assert np.mean(pours) == pytest.approx(asked, abs=3.0 if name == "wet clay" else 2.0)
