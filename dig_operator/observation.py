"""Observation and Command of an operator, and the low-pass filter of the observed base pose.

An observation holds only data that the public topics carry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dig_operator.observed_machine import ObservedMachine
from machine_sim.ground.contact_surface import surface_at
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.quick_init import quick_init

__all__ = ["BaseFilter", "Command", "Observation"]

Array = NDArray[np.float64]

_NUM_STRIP_LINES = 5
"""Lines along a strip of terrain on which its heights are taken."""


@quick_init
@dataclass(frozen=True)
class Observation:
    """State of machine and terrain at the end of a tick.

    Attributes:
        time: simulation time [s].
        joints: angles of the machine's joints [rad], shape (joints,).
        base_position: position of base_link [m], map frame, shape (3,).
        base_rotation: rotation from base_link to map, shape (3, 3).
        fill: fill of the bucket, as a fraction of its heaped capacity.
        grid: grid of the terrain.
        elevation: height of the terrain [m], shape (rows, cols).
        bank_m3: bank volume of the soil in the bucket [m^3].
        is_soil_moving: whether soil outside the bucket is still falling, settling or sliding.
        others: the other machines that the operator watches.
    """

    time: float
    joints: Array
    base_position: Array
    base_rotation: Array
    fill: float
    grid: Grid
    elevation: Array
    bank_m3: float = 0.0
    is_soil_moving: bool = False
    others: tuple[ObservedMachine, ...] = ()

    @property
    def yaw(self) -> float:
        """Heading of the base [rad], counter-clockwise from the map's +x."""
        return float(np.arctan2(self.base_rotation[1, 0], self.base_rotation[0, 0]))

    def with_base(self, position: Array, rotation: Array) -> Observation:
        """Return the observation with another pose of the base."""
        pose = {"base_position": position, "base_rotation": rotation}
        return Observation(**{**vars(self), **pose})  # faster than `dataclasses.replace`

    def surface_heights(self, x: Array, y: Array) -> Array:
        """Return the terrain height [m] at points of the map frame, same shape as x and y."""
        frame = (self.grid.x_first, self.grid.y_first, 1.0 / self.grid.cell)
        z = [surface_at(self.elevation, *frame, *p)[0] for p in zip(x.flat, y.flat, strict=True)]
        return np.array(z).reshape(x.shape)

    def mean_strip_heights(self, azimuth: float, radius: Array, width: float) -> Array:
        """Return the mean height across a radial strip of terrain [m], shape (n,).

        Args:
            azimuth: direction of the strip [rad], map frame.
            radius: distances from the base's origin [m], shape (n,).
            width: width of the strip [m].
        """
        mean: Array = self._strip_heights(azimuth, radius, width).mean(axis=0)
        return mean

    def max_strip_height(self, azimuth: float, radius: Array, width: float) -> float:
        """Return the maximum height of a radial strip of terrain [m]; see `mean_strip_heights`."""
        return float(self._strip_heights(azimuth, radius, width).max())

    def _strip_heights(self, azimuth: float, radius: Array, width: float) -> Array:
        """Return the heights of a strip [m], from its right edge to its left, shape (5, n)."""
        across = np.linspace(-0.5 * width, 0.5 * width, _NUM_STRIP_LINES)[:, None]
        c, s = np.cos(azimuth), np.sin(azimuth)
        x = self.base_position[0] + radius * c - across * s
        y = self.base_position[1] + radius * s + across * c
        return self.surface_heights(x, y)


@quick_init
@dataclass(frozen=True)
class Command:
    """Command for one tick.

    Attributes:
        joints: velocities of the machine's joints [rad/s], shape (joints,).
        tracks: speeds of the left and the right track [m/s], shape (2,).
    """

    joints: Array
    tracks: Array


class BaseFilter:
    """First-order low-pass filter of the base pose.

    It follows a lasting tilt and suppresses rocking: an arm that compensated every oscillation of
    the base would excite it.
    """

    def __init__(self, time_constant: float) -> None:
        """Create a filter with a time constant [s]."""
        self._time_constant = time_constant
        self._position: Array | None = None
        self._rotation: Array = np.eye(3)  # an average, so not exactly a rotation

    def update(self, observation: Observation, dt: float) -> Observation:
        """Return the observation with the filtered base pose, `dt` [s] after the previous one."""
        if self._position is None:
            self._position, self._rotation = observation.base_position, observation.base_rotation
        weight = min(1.0, dt / self._time_constant)
        self._position = self._position + weight * (observation.base_position - self._position)
        self._rotation = self._rotation + weight * (observation.base_rotation - self._rotation)
        # The rotation nearest to the average.
        u, _, v = np.linalg.svd(self._rotation)
        return observation.with_base(self._position, u.dot(v))
