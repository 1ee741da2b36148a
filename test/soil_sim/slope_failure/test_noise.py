"""Noise is off by default, reproducible by its seed, and keeps the volume exact."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.soil_scenes import NO_SWEEPS, come_to_rest, contour_radii, make_deposit_requests

from msg_bridge.contract.grid import Grid
from soil_sim.slope_failure import relaxation_noise, surface_tilt
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

GRID = Grid(61, 61, 0.2)


def heap(**params: object) -> Soil:
    """Return a pile of 1.8 m^3, deposited at one point, at rest."""
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(**params))  # type: ignore[arg-type]
    for tick in range(150):
        soil.step(tick, NO_SWEEPS, make_deposit_requests(0.0, 0.0, 12_000_000))
    come_to_rest(soil)
    assert soil.verify_volume()
    assert soil.columns.loose.sum() == 150 * 12_000_000
    assert soil.relaxation.max_slope_excess() <= 2 * soil.params.relaxation_tolerance
    return soil


def test_seed_has_no_effect_without_noise() -> None:
    assert heap(noise_seed=1).state_hash() == heap(noise_seed=2).state_hash()


@pytest.mark.parametrize("noise", [{"repose_angle_noise": 4.0}, {"redistribution_noise": 0.8}])
def test_noise_is_reproducible_by_its_seed(noise: dict[str, float]) -> None:
    hashes = [heap(noise_seed=seed, **noise).state_hash() for seed in (1, 1, 2)]
    assert hashes[0] == hashes[1] != hashes[2]


def test_angles_of_repose_vary_around_that_of_the_soil() -> None:
    params = SoilParams(repose_angle=32.0, repose_angle_noise=5.0)
    noise = relaxation_noise(params, GRID, math.radians(32.0))
    angles = np.degrees(np.arctan(noise.repose_tan_scale * math.tan(math.radians(32.0))))
    assert angles.min() == pytest.approx(27.0, abs=0.1)
    assert angles.max() == pytest.approx(37.0, abs=0.1)
    assert angles.mean() == pytest.approx(32.0, abs=0.2)


def test_redistribution_noise_makes_a_heap_less_round() -> None:
    def spread(**params: object) -> float:
        radii = contour_radii(heap(**params), 0.1, 180)
        return float(radii.std() / radii.mean())

    without_noise = spread()
    with_noise = np.mean([spread(redistribution_noise=1.0, noise_seed=seed) for seed in range(3)])
    assert with_noise > 1.3 * without_noise


def test_surface_tilt_is_bounded_and_zero_by_default() -> None:
    assert not surface_tilt(SoilParams(), GRID).any()
    tilt = surface_tilt(SoilParams(surface_tilt_noise=10.0), GRID)
    assert tilt.shape == (61, 61, 2)
    assert np.abs(tilt).max() <= math.tan(math.radians(10.0)) + 1e-6
    assert tilt.std() > 0.05
