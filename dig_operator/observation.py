"""What an operator sees and does: nothing that public topics do not carry."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import surface_at
from msg_bridge.contract.grid import Grid

__all__ = ["BaseFilter", "Command", "Observation"]


@dataclass(frozen=True)
class Observation:
    """What is seen at the beginning of a tick.

    Attributes:
        time: simulation time [s].
        joints: angles of the machine's joints [rad].
        base_position: of base_link (3,) [m], map frame.
        base_rotation: base_link to map (3, 3).
        fill: soil in the bucket, in parts of its heaped capacity.
        bank: the same as bank volume [m^3].
        grid, elevation: the terrain as published [m], shape (rows, cols).
        moving: whether soil outside the bucket still falls, lands or slips.
    """

    time: float
    joints: NDArray[np.float64]
    base_position: NDArray[np.float64]
    base_rotation: NDArray[np.float64]
    fill: float
    grid: Grid
    elevation: NDArray[np.float64]
    bank: float = 0.0
    is_soil_moving: bool = False

    @property
    def yaw(self) -> float:
        """Where the base faces [rad], from the map's +x counter-clockwise."""
        return float(np.arctan2(self.base_rotation[1, 0], self.base_rotation[0, 0]))

    def surface_heights(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Surface [m] at points of the map frame, same shape as x and y."""
        frame = (self.grid.x_first, self.grid.y_first, 1.0 / self.grid.cell)
        z = [surface_at(self.elevation, *frame, *p)[0] for p in zip(x.flat, y.flat, strict=True)]
        return np.array(z).reshape(x.shape)

    def mean_strip_heights(
        self, azimuth: float, radius: NDArray[np.float64], width: float
    ) -> NDArray[np.float64]:
        """Mean surface [m] across a strip that runs out from the base.

        Args:
            azimuth: direction of the strip [rad], map frame.
            radius: distances from the base's origin [m], shape (n,).
            width: of the strip [m].

        Returns:
            Shape (n,).
        """
        mean: NDArray[np.float64] = self._strip_heights(azimuth, radius, width).mean(axis=0)
        return mean

    def max_strip_height(self, azimuth: float, radius: NDArray[np.float64], width: float) -> float:
        """Highest surface [m] of such a strip."""
        return float(self._strip_heights(azimuth, radius, width).max())

    def _strip_heights(
        self, azimuth: float, radius: NDArray[np.float64], width: float
    ) -> NDArray[np.float64]:
        """Surface [m] of a strip, from its right edge to its left, shape (5, n)."""
        across = np.linspace(-0.5 * width, 0.5 * width, 5)[:, None]
        c, s = np.cos(azimuth), np.sin(azimuth)
        x = self.base_position[0] + radius * c - across * s
        y = self.base_position[1] + radius * s + across * c
        return self.surface_heights(x, y)


@dataclass(frozen=True)
class Command:
    """What is done in a tick.

    Attributes:
        joints: velocities of the machine's joints [rad/s].
        tracks: speeds of the left and right track [m/s].
    """

    joints: NDArray[np.float64]
    tracks: NDArray[np.float64]


class BaseFilter:
    """A slow eye for the base: what rocks is not followed, what leans is.

    An arm that answered every rocking of the base would rock it more.
    """

    def __init__(self, time_constant: float) -> None:
        """`time_constant` is how long it looks before it believes a change [s]."""
        self._time_constant = time_constant
        self._position: NDArray[np.float64] | None = None
        self._rotation: NDArray[np.float64] = np.eye(3)  # on average, so not quite a rotation

    def update(self, observation: Observation, dt: float) -> Observation:
        """The same view with the base as it stands on average, `dt` [s] after the last one."""
        if self._position is None:
            self._position, self._rotation = observation.base_position, observation.base_rotation
        part = min(1.0, dt / self._time_constant)
        self._position = self._position + part * (observation.base_position - self._position)
        self._rotation = self._rotation + part * (observation.base_rotation - self._rotation)
        # The mean of rotations near one another, made a rotation again.
        u, _, v = np.linalg.svd(self._rotation)
        return replace(observation, base_rotation=u @ v, base_position=self._position)
