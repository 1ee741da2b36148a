"""Looking at the terrain: where to dig, how high to swing, how high to dump."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.errors import ReachError
from machine_sim.machine.tools.bucket import BucketShape
from machine_sim.operator.arm import ArmPlane
from machine_sim.operator.dig import DigReach
from machine_sim.operator.params import OperatorParams
from machine_sim.operator.view import View

__all__ = ["Survey"]


class Survey:
    """What an operator takes from the terrain it sees."""

    def __init__(self, arm: ArmPlane, params: OperatorParams, bucket: BucketShape) -> None:
        self._arm = arm
        self._params = params
        self._bucket = bucket

    def least_dug(self, view: View, middle: float) -> float:
        """The direction [rad] in the dig sector about `middle` where the ground is highest."""
        half = self._params.dig_sector
        choices = middle + half * np.array([0.0, -1.0, 1.0, -0.5, 0.5])
        radius = np.linspace(self._params.near, self._params.far, 20)
        level = [view.on_line(a, radius, self._bucket.width).mean() for a in choices]
        return float(choices[int(np.argmax(np.round(level, 2)))])

    def profile(
        self, view: View, azimuth: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Radius and surface [m] along the arm's plane, shape (n,) each."""
        radius = np.arange(self._params.near - 0.5, self._params.far + 0.5, 0.1)
        return radius, view.on_line(azimuth, radius, self._bucket.width)

    def reach(self, view: View, azimuth: float, attitude: float) -> DigReach:
        """Where the lip can dig, entering at that attitude."""
        return DigReach(
            near=self._params.near,
            far=self._far(view, azimuth, attitude),
            lowest=float(view.base_position[2]) - self._params.deepest,
            width=self._bucket.width,
            deepest_cut=self._params.deepest_cut,
        )

    def swing_height(self, view: View, start: float, end: float) -> float:
        """Height of the pin [m] at which a level bucket clears all ground from start to end."""
        turn = math.remainder(end - start, 2 * math.pi)
        radius = np.linspace(self._params.near, self._params.far, 12)
        tops = [
            view.highest(start + part * turn, radius, 2.0 * self._bucket.width)
            for part in np.linspace(0.0, 1.0, 9)
        ]
        return max(tops) + self._arm.depth_below_pin + self._params.clearance

    def dump_height(self, view: View, azimuth: float) -> float:
        """Height of the pin [m] at which the bucket clears the heap under it while it opens."""
        length = self._bucket.tip_length
        middle = self._params.dump_radius
        radius = np.linspace(middle - length, middle + length, 12)
        top = view.highest(azimuth, radius, 2.0 * self._bucket.width)
        return top + length + self._params.clearance

    def _far(self, view: View, azimuth: float, attitude: float) -> float:
        """Largest radius at which the lip can come down from its clearance to the ground.

        Raises:
            ReachError: there is none with room for a drag.
        """
        radius, surface = self.profile(view, azimuth)
        for far in np.arange(self._params.far, self._params.near + 1.0, -0.1).tolist():
            ground = float(np.interp(far, radius, surface))
            with suppress(ReachError):
                for above in (self._params.clearance, -self._params.deepest_cut):
                    self._arm.joints(view, self._arm.lip_at(azimuth, far, ground + above, attitude))
                return float(far)
        raise ReachError(
            f"in direction {math.degrees(azimuth):.0f} deg no ground from {self._params.near} to"
            f" {self._params.far} m can be dug from here; move the machine, or change near and far"
        )
