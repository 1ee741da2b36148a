"""Specific energy of milling: rock by the force on a pick, soil by its strength and weight."""

import math

import pytest

from soil_sim.tool_force.rock_pick import pick_force
from soil_sim.tool_force.specific_energy import rock_specific_energy


def test_specific_energy_of_a_sandstone_of_40_mpa():
    """The groove of a pick at depth d has the section d^2 tan(60 deg); 0.4 of the peak is mean."""
    depth = 0.01
    force = pick_force(
        depth=depth,
        tip_angle=math.radians(80.0),
        tensile_strength=3e6,
        compressive_strength=40e6,
    ).cutting
    expected = 0.4 * force / (depth**2 * math.tan(math.radians(60.0)))
    assert rock_specific_energy(3e6) == pytest.approx(expected)
    assert rock_specific_energy(3e6) == pytest.approx(7.95e6, rel=0.01)
