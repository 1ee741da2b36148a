"""Bearing force of the ground on plates and edges that rest on it."""

import numpy as np
import pytest
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    bucket_sweep,
    flat_soil,
    packed_soil,
    tool_sweep,
)

from msg_bridge.contract.rows import Rows, SoilReaction, SweepAction
from soil_sim.soil import Soil
from soil_sim.soils.soil_types import load_soil_types

LOAM = load_soil_types()["loam"]


def bearing_force(soil: Soil, sweep: Rows) -> np.ndarray:
    """Return the bearing force on a tool [N]; zeros without a row."""
    rows = soil.step(0, sweep, NO_DEPOSIT_REQUESTS).forces
    rows = rows[rows["reaction"] == SoilReaction.BEARING]
    return np.array([rows[name].sum() for name in ("fx", "fy", "fz")], dtype=np.float64)


@pytest.mark.parametrize("action", [SweepAction.CUT, SweepAction.COMPACT])
@pytest.mark.parametrize("start", [0.001, -0.01], ids=["pressed down", "at rest"])
def test_bearing_force_on_bucket_is_capacity_of_a_footing(start, action) -> None:
    sweep = bucket_sweep((0, 0, start), (0, 0, -0.01))
    sweep["action"][:4] = action  # of the floor, as machines publish it
    found = bearing_force(flat_soil(6.0, 0.2, soil="loam"), sweep)
    assert found[1] == pytest.approx(0.0, abs=1e-3)
    # c N_c alone: 8 kPa * 1.2 (loam at its natural moisture) * 38.6, on a floor of 0.4 m x 1.2 m
    assert 0.9 * 9.6e3 * 38.6 * 0.48 < found[2] < 2.0 * 9.6e3 * 38.6 * 0.48


@pytest.mark.parametrize("depth", [0.0, 0.1])
def test_rock_bears_a_tool_under_its_lowest_edge(depth) -> None:
    on_end = ((0.0, 1.0), (-0.4, 1.2), (-0.8, 0.8), (-0.8, 0.0))  # of an upright plate
    sweep = tool_sweep(on_end, (0, 0, 0.01), (0, 0, -depth))
    rows = flat_soil(6.0, 0.2, soil="rock").step(0, sweep, NO_DEPOSIT_REQUESTS).forces
    (row,) = rows[rows["reaction"] == SoilReaction.BEARING]
    assert row["fx"] == row["fy"] == 0.0
    assert row["fz"] > 1e6, "more than a machine weighs"
    assert row["x"] == pytest.approx(-0.8)
    assert row["z"] == pytest.approx(-depth, abs=1e-3)


def test_bucket_in_the_air_has_no_bearing_force() -> None:
    above = bucket_sweep((0, 0, 0.05), (0.02, 0, 0.05))
    assert not bearing_force(flat_soil(6.0, 0.2, soil="loam"), above).any()


def test_track_that_compacts_has_no_bearing_force() -> None:
    track = tool_sweep(((0.0, 0.0), (-1.0, -0.5)), (0, 0, 0.001), (0, 0, -0.01))
    track["action"] = SweepAction.COMPACT
    assert not bearing_force(flat_soil(6.0, 0.2, soil="loam"), track).any()


def test_bearing_force_on_edge_grows_with_depth() -> None:
    wall = ((0.0, 0.0), (0.0, 1.0))
    found = [
        bearing_force(flat_soil(6.0, 0.1, soil="loam"), tool_sweep(wall, (0, 0, z), (0, 0, z)))[2]
        for z in (-0.01, -0.4)
    ]
    gamma, n_q = LOAM.density * 9.81, 26.1  # at 33 degrees
    deeper = gamma * 0.39 * n_q * 0.04 * 1.2
    assert found[1] - found[0] == pytest.approx(deeper, rel=0.05)


def test_bearing_capacity_grows_with_the_cohesion_of_packed_soil() -> None:
    def capacity(rut_depth: float) -> float:
        sweep = bucket_sweep((0, 0, 0.001 - rut_depth), (0, 0, -rut_depth))
        return float(bearing_force(packed_soil(rut_depth), sweep)[2])

    factors = [capacity(depth) / capacity(0.0) for depth in (0.02, 0.1, 0.2)]
    assert 1.0 < factors[0] < factors[1]
    strength = LOAM.packed_strength
    assert 0.85 * strength < factors[1] < strength, "all but the terms of its weight"
    assert factors[2] == pytest.approx(factors[1], rel=0.01), "the footing is on packed soil only"
