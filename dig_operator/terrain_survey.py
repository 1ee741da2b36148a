"""Looking at the terrain: where to dig, how high to swing, how high to dump."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from dig_operator.bucket_kinematics import BucketKinematics
from dig_operator.dig_plan import DigReach
from dig_operator.observation import Observation
from dig_operator.params import BehaviourParams
from machine_sim.machine.errors import ReachError
from machine_sim.machine.tools.bucket import BucketShape

__all__ = ["TerrainSurvey"]


class TerrainSurvey:
    """What an operator takes from the terrain it sees."""

    def __init__(
        self, kinematics: BucketKinematics, params: BehaviourParams, bucket: BucketShape
    ) -> None:
        self._kinematics = kinematics
        self._params = params
        self._bucket = bucket

    def highest_ground_azimuth(self, observation: Observation, middle: float) -> float:
        """The direction [rad] in the dig sector about `middle` where the ground is highest."""
        half = self._params.dig_sector_half_width
        choices = middle + half * np.array([0.0, -1.0, 1.0, -0.5, 0.5])
        radius = np.linspace(self._params.min_radius, self._params.max_radius, 20)
        level = [
            observation.mean_strip_heights(a, radius, self._bucket.width).mean() for a in choices
        ]
        return float(choices[int(np.argmax(np.round(level, 2)))])

    def surface_profile(
        self, observation: Observation, azimuth: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Radius and surface [m] along the arm's plane, shape (n,) each."""
        radius = np.arange(self._params.min_radius - 0.5, self._params.max_radius + 0.5, 0.1)
        return radius, observation.mean_strip_heights(azimuth, radius, self._bucket.width)

    def dig_reach(self, observation: Observation, azimuth: float, attitude: float) -> DigReach:
        """Where the lip can dig, entering at that attitude."""
        return DigReach(
            min_radius=self._params.min_radius,
            max_radius=self._max_radius(observation, azimuth, attitude),
            min_height=float(observation.base_position[2]) - self._params.max_dig_depth,
            width=self._bucket.width,
            max_cut_depth=self._params.max_cut_depth,
        )

    def swing_clearance_height(self, observation: Observation, start: float, end: float) -> float:
        """Height of the pin [m] at which a level bucket clears all ground from start to end."""
        turn = math.remainder(end - start, 2 * math.pi)
        radius = np.linspace(self._params.min_radius, self._params.max_radius, 12)
        tops = [
            observation.max_strip_height(start + part * turn, radius, 2.0 * self._bucket.width)
            for part in np.linspace(0.0, 1.0, 9)
        ]
        return max(tops) + self._kinematics.depth_below_pin + self._params.clearance

    def dump_clearance_height(self, observation: Observation, azimuth: float) -> float:
        """Height of the pin [m] at which the bucket clears the heap under it while it opens."""
        length = self._bucket.tip_radius
        middle = self._params.dump_radius
        radius = np.linspace(middle - length, middle + length, 12)
        top = observation.max_strip_height(azimuth, radius, 2.0 * self._bucket.width)
        return top + length + self._params.clearance

    def _max_radius(self, observation: Observation, azimuth: float, attitude: float) -> float:
        """Largest radius at which the lip can come down from its clearance to the ground.

        Raises:
            ReachError: there is none with room for a drag.
        """
        radius, surface = self.surface_profile(observation, azimuth)
        for max_radius in np.arange(
            self._params.max_radius, self._params.min_radius + 1.0, -0.1
        ).tolist():
            ground = float(np.interp(max_radius, radius, surface))
            with suppress(ReachError):
                for above in (self._params.clearance, -self._params.max_cut_depth):
                    self._kinematics.joint_angles(
                        observation,
                        self._kinematics.pose_with_lip_at(
                            azimuth, max_radius, ground + above, attitude
                        ),
                    )
                return float(max_radius)
        raise ReachError(
            f"in direction {math.degrees(azimuth):.0f} deg no ground from {self._params.min_radius} to"
            f" {self._params.max_radius} m can be dug from here; move the machine, or change min_radius and max_radius"
        )
