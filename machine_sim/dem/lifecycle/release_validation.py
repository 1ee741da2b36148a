"""Validation of the soil that is given to an engine."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.state import ParticleError
from msg_bridge.contract.rows import MAX_ROW_VOLUME
from msg_bridge.kernels import kernel

__all__ = ["ReleaseBatch", "validate_release"]

_MAX_COORDINATE = 1e6
"""Maximum coordinate [m]."""
_MAX_SPEED = 1e3
"""Maximum speed [m/s]; far above that of soil, far below where squares overflow in float32."""

_NOT_FINITE, _TOO_FAR, _TOO_FAST = 1, 2, 3
_ERRORS = {
    _NOT_FINITE: "position and velocity must be finite",
    _TOO_FAR: f"positions must be within {_MAX_COORDINATE:g} m of the map's origin",
    _TOO_FAST: f"speeds must not exceed {_MAX_SPEED:g} m/s",
}


class ReleaseBatch(NamedTuple):
    """Soil to be released, one row per particle.

    Attributes:
        position, velocity: [m], [m/s], map frame, shape (n, 3).
        volume_mm3: bank volume [mm^3], shape (n,).
        soil: soil type ids, shape (n,).
        moisture: [% of saturation], shape (n,).
    """

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
    """Return the arguments of `SoilEngine.add` as arrays of one length.

    Raises:
        ParticleError: shapes that do not match, values that are not finite, coordinates beyond
            1e6 m, speeds above 1000 m/s, or volumes or codes out of range.
    """
    x = np.atleast_2d(np.asarray(position, dtype=np.float64))
    v = np.atleast_2d(np.asarray(velocity, dtype=np.float64))
    n = len(x) if x.size else 0
    if x.shape != v.shape or (n and x.shape != (n, 3)):
        raise ParticleError(
            f"position has shape {x.shape} and velocity {v.shape}; give (n, 3) for both"
        )
    error = _motion_error(x.reshape(n, 3), v.reshape(n, 3))
    if error:
        raise ParticleError(_ERRORS[error])
    volume = _validate_integers("volume_mm3", volume_mm3, n, 1, MAX_ROW_VOLUME)
    soils = _validate_integers("soil", soil, n, 0, 255).astype(np.uint8)
    moistures = _validate_integers("moisture", moisture, n, 0, 255).astype(np.uint8)
    return ReleaseBatch(x.reshape(n, 3), v.reshape(n, 3), volume, soils, moistures)


@kernel
def _motion_error(position, velocity):  # type: ignore[no-untyped-def]
    """Return the error code of some positions and velocities, 0 if all are valid."""
    if not (np.isfinite(position).all() and np.isfinite(velocity).all()):
        return _NOT_FINITE
    for i in range(position.shape[0]):
        speed2 = 0.0
        for axis in range(3):
            if abs(position[i, axis]) > _MAX_COORDINATE:
                return _TOO_FAR
            speed2 += velocity[i, axis] ** 2
        if speed2 > _MAX_SPEED**2:
            return _TOO_FAST
    return 0


def _validate_integers(
    name: str, value: ArrayLike, n: int, low: int, high: int
) -> NDArray[np.int64]:
    """Return one integer for each of n particles; values are not checked where n is 0."""
    values = np.asarray(value)
    if values.shape not in ((), (n,)):
        raise ParticleError(f"{name} has shape {values.shape}; give one value, or one per particle")
    if n and (values.dtype.kind not in "iu" or values.min() < low or values.max() > high):
        raise ParticleError(f"{name} must be whole numbers from {low} to {high}")
    return values.astype(np.int64) if values.shape else np.full(n, values, dtype=np.int64)
