"""Synthetic terrain: level, sloping or rough ground."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from soil_sim.errors import TerrainError, TerrainErrorCode
from soil_sim.terrain.height_map import HeightMap

__all__ = ["flat", "rough", "slope"]

_MARGIN = 2.5
"""Margin around the map [correlation lengths]: the spectral filter is periodic, and at this
distance the correlation is exp(-2.5**2) = 0.2 %."""


def flat(grid: Grid, height: float = 0.0) -> HeightMap:
    """Return level ground at `height` [m].

    Raises:
        TerrainError: the height is not finite or beyond `HEIGHT_LIMIT`.
    """
    return HeightMap(grid, np.full(grid.shape, height, dtype=np.float64))


def slope(grid: Grid, angle: float, direction: float) -> HeightMap:
    """Return a plane through z = 0 at the centre of the map.

    Args:
        grid: grid of the heights.
        angle: inclination [rad], from 0 to below pi/2.
        direction: direction of steepest ascent [rad], counter-clockwise from +x.

    Raises:
        TerrainError: an angle is out of range, or heights exceed `HEIGHT_LIMIT`.
    """
    if not 0.0 <= angle < 0.5 * math.pi:
        raise TerrainError(
            f"angle is {angle!r} rad; give one from 0 to below pi/2", TerrainErrorCode.ARGUMENT
        )
    if not math.isfinite(direction):
        raise TerrainError(
            f"direction is {direction!r} rad; give a finite angle from +x",
            TerrainErrorCode.ARGUMENT,
        )
    x = grid.x(np.arange(grid.rows))[:, None]
    y = grid.y(np.arange(grid.cols))[None, :]
    distance = x * math.cos(direction) + y * math.sin(direction)
    return HeightMap(grid, math.tan(angle) * distance)


def rough(grid: Grid, rms: float, correlation_length: float, rng: np.random.Generator) -> HeightMap:
    """Return random ground: a Gaussian field with Gaussian correlation and mean height 0.

    The correlation of heights at a distance d is exp(-(d / correlation_length)**2).

    Args:
        grid: grid of the heights.
        rms: root mean square of the heights [m]; exact in every map.
        correlation_length: distance at which the correlation is 1/e [m], from one cell to the
            shorter side of the map.
        rng: random generator; equal states give equal ground.

    Raises:
        TerrainError: rms or correlation_length is out of range.
    """
    if not (math.isfinite(rms) and rms >= 0.0):
        raise TerrainError(
            f"rms is {rms!r} m; give a finite height, not negative", TerrainErrorCode.ARGUMENT
        )
    max_length = min(grid.size)
    if not grid.cell <= correlation_length <= max_length:
        raise TerrainError(
            f"correlation_length is {correlation_length!r} m; give one from a cell,"
            f" {grid.cell:g} m, to the shorter side of the map, {max_length:g} m",
            TerrainErrorCode.ARGUMENT,
        )
    field = _correlated_noise(grid, correlation_length, rng)
    field -= field.mean()
    return HeightMap(grid, field * (rms / math.sqrt(np.mean(field * field))))


def _correlated_noise(grid: Grid, length: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return white noise filtered in the spectrum, shape (rows, cols), of arbitrary amplitude.

    The spectrum of exp(-(d/L)**2) is exp(-(k L)**2 / 4); the filter is its square root.
    """
    margin = math.ceil(_MARGIN * length / grid.cell)
    rows, cols = grid.rows + margin, grid.cols + margin
    noise = np.fft.rfft2(rng.standard_normal((rows, cols)))
    kx = 2.0 * np.pi * np.fft.fftfreq(rows, grid.cell)[:, None]
    ky = 2.0 * np.pi * np.fft.rfftfreq(cols, grid.cell)[None, :]
    noise *= np.exp(-(kx * kx + ky * ky) * length * length / 8.0)
    return np.asarray(np.fft.irfft2(noise, s=(rows, cols))[: grid.rows, : grid.cols])
