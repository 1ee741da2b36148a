"""Random variation of slopes, reproducible by a seed; off by default.

The 2014 reference names random variation of the shape of a pile, its angle and its surface normal
as missing from its model.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.kernels import helper
from soil_sim.soils.params import SoilParams

__all__ = ["RelaxationNoise", "random_uniform", "relaxation_noise", "surface_tilt"]

_ANGLE_STREAM, _JITTER_STREAM, _NORMAL_STREAM = 1, 2, 3
"""Independent streams of random numbers of one seed."""

_MIN_ANGLE, _MAX_ANGLE = 0.01, 1.5
"""Limits of the angle of repose of a column [rad]."""


class RelaxationNoise(NamedTuple):
    """Random variation of how soil slides.

    Attributes:
        repose_tan_scale: tangent of the angle of repose of each column over that of its soil, flat,
            float64; empty if it is 1 everywhere.
        jitter: 0 to 1, randomness of where soil is deposited: it does not always slide in the
            steepest direction, and may move on from where it could stay.
        seed: seed of that randomness.
    """

    repose_tan_scale: NDArray[np.float64]
    jitter: float
    seed: int


def relaxation_noise(params: SoilParams, grid: Grid, angle: float) -> RelaxationNoise:
    """Return the noise that parameters describe.

    Args:
        params: amplitudes and seed.
        grid: grid of the terrain.
        angle: angle of repose of `params.soil` [rad]; that of a column differs by up to
            `params.repose_angle_noise`, that of other kinds by the same factor of the tangent.
    """
    repose_tan_scale: NDArray[np.float64] = np.zeros(0)
    if params.repose_angle_noise > 0.0:
        rng = np.random.default_rng([params.noise_seed, _ANGLE_STREAM])
        amplitude = math.radians(params.repose_angle_noise)
        angles = angle + rng.uniform(-amplitude, amplitude, grid.rows * grid.cols)
        repose_tan_scale = np.tan(np.clip(angles, _MIN_ANGLE, _MAX_ANGLE)) / math.tan(angle)
    seed = int(np.random.default_rng([params.noise_seed, _JITTER_STREAM]).integers(2**62))
    return RelaxationNoise(repose_tan_scale, params.redistribution_noise, seed)


def surface_tilt(params: SoilParams, grid: Grid) -> NDArray[np.float32]:
    """Return the random tilt of the surface of loose soil, for visualization.

    Returns:
        Slopes along x and y, shape (rows, cols, 2), float32, up to tan(`params.surface_tilt_noise`)
        each; zeros if the noise is off.
    """
    if params.surface_tilt_noise == 0.0:
        return np.zeros((*grid.shape, 2), dtype=np.float32)
    rng = np.random.default_rng([params.noise_seed, _NORMAL_STREAM])
    amplitude = math.tan(math.radians(params.surface_tilt_noise))
    return rng.uniform(-amplitude, amplitude, (*grid.shape, 2)).astype(np.float32)


@helper(forceinline=True)
def random_uniform(state):  # type: ignore[no-untyped-def]
    """Return the next random number from 0 to 1 (xorshift64*, Vigna 2016).

    Args:
        state: state of the generator, shape (1,), uint64; changed.
    """
    x = state[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[0] = x
    return ((x * np.uint64(2685821657736338717)) >> np.uint64(11)) * (1.0 / 9007199254740992.0)
