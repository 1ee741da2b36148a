"""Noise: nature is uneven, by seed and repeatably; off unless asked for.

The 2014 work names noise in a pile's shape, its angle and its surface normal as what is missing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.slope_failure.relaxation import RelaxationNoise
from soil_sim.soils.params import SoilParams

__all__ = ["relaxation_noise", "surface_tilt"]

_ANGLE_STREAM, _JITTER_STREAM, _NORMAL_STREAM = 1, 2, 3  # streams of random numbers, one each


def relaxation_noise(params: SoilParams, grid: Grid, angle: float) -> RelaxationNoise:
    """Unevenness of the angle of repose and of the way soil takes.

    Args:
        params: how much of it, and its seed.
        grid: of the terrain.
        angle: angle of repose of the ground's own soil [rad]; that of a column is up to
            `params.repose_angle_noise` more or less, of other kinds by the same part of the tangent.
    """
    repose_tan_scale: NDArray[np.float64] = np.zeros(0)
    if params.repose_angle_noise > 0.0:
        rng = np.random.default_rng([params.noise_seed, _ANGLE_STREAM])
        most = math.radians(params.repose_angle_noise)
        own = np.clip(angle + rng.uniform(-most, most, grid.rows * grid.cols), 0.01, 1.5)
        repose_tan_scale = np.tan(own) / math.tan(angle)
    shape_seed = int(np.random.default_rng([params.noise_seed, _JITTER_STREAM]).integers(2**62))
    return RelaxationNoise(repose_tan_scale, params.redistribution_noise, shape_seed)


def surface_tilt(params: SoilParams, grid: Grid) -> NDArray[np.float32]:
    """By how much loose soil's surface leans from the smooth one, for whoever draws it.

    Returns:
        Slopes along x and y, shape (rows, cols, 2), up to tan(`params.surface_tilt_noise`) each; zeros
        if there is none.
    """
    if params.surface_tilt_noise == 0.0:
        return np.zeros((*grid.shape, 2), dtype=np.float32)
    rng = np.random.default_rng([params.noise_seed, _NORMAL_STREAM])
    most = math.tan(math.radians(params.surface_tilt_noise))
    return rng.uniform(-most, most, (*grid.shape, 2)).astype(np.float32)
