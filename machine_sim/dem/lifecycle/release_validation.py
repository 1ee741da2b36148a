"""What is soil to an engine, and what is refused."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.state import ParticleError
from msg_bridge.contract.rows import MAX_ROW_VOLUME

__all__ = ["ReleaseBatch", "validate_release"]

_MAX_COORDINATE = 1e6
"""Largest coordinate [m]."""
_MAX_SPEED = 1e3
"""Largest speed [m/s]; far above what soil has, far below where squares overflow in float32."""


class ReleaseBatch(NamedTuple):
    """Soil to be released, one row per particle: [m], [m/s], [mm^3], ids, [% of saturation]."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    volume_mm3: NDArray[np.int64]
    soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]


def validate_release(
    position: ArrayLike,
    velocity: ArrayLike,
    volume_mm3: ArrayLike,
    soil: ArrayLike,
    moisture: ArrayLike,
) -> ReleaseBatch:
    """Arrays of one length, of what a caller of `ParticleEngine.add` gives.

    Raises:
        ParticleError: shapes that do not fit, values that are not finite, coordinates beyond
            1e6 m, speeds above 1000 m/s, volumes or codes out of range.
    """
    x = np.atleast_2d(np.asarray(position, dtype=np.float64))
    v = np.atleast_2d(np.asarray(velocity, dtype=np.float64))
    n = len(x) if x.size else 0
    if x.shape != v.shape or (n and x.shape != (n, 3)):
        raise ParticleError("positions and velocities must both have shape (n, 3)")
    if not (np.isfinite(x).all() and np.isfinite(v).all()):
        raise ParticleError("positions and velocities must be finite")
    if n and np.abs(x).max() > _MAX_COORDINATE:
        raise ParticleError(f"positions must be within {_MAX_COORDINATE:g} m of the map's origin")
    # Components first: the square of a huge one overflows.
    if n and (np.abs(v).max() > _MAX_SPEED or np.linalg.norm(v, axis=1).max() > _MAX_SPEED):
        raise ParticleError(f"speeds must not be above {_MAX_SPEED:g} m/s")
    volume = _validate_integers("volumes", volume_mm3, n, 1, MAX_ROW_VOLUME)
    soils = _validate_integers("soils", soil, n, 0, 255).astype(np.uint8)
    moistures = _validate_integers("moistures", moisture, n, 0, 255).astype(np.uint8)
    return ReleaseBatch(x.reshape(n, 3), v.reshape(n, 3), volume, soils, moistures)


def _validate_integers(
    name: str, given: ArrayLike, n: int, low: int, high: int
) -> NDArray[np.int64]:
    """Whole numbers, one for each of n; any will do where there is none."""
    values = np.asarray(given)
    if values.shape not in ((), (n,)):
        raise ParticleError(f"{name} must be one per particle, or one")
    if n and (values.dtype.kind not in "iu" or values.min() < low or values.max() > high):
        raise ParticleError(f"{name} are whole numbers from {low} to {high}")
    return np.broadcast_to(values, (n,)).astype(np.int64)
