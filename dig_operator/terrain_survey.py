"""TerrainSurvey: where to dig, and how high to swing and to dump, from the observed terrain."""

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
    """Evaluates the terrain for one bucket and behaviour."""

    def __init__(
        self, kinematics: BucketKinematics, params: BehaviourParams, bucket: BucketShape
    ) -> None:
        self._kinematics = kinematics
        self._params = params
        self._bucket = bucket

    def highest_ground_azimuth(self, observation: Observation, sector_azimuth: float) -> float:
        """Return the direction [rad] of the highest ground in the dig sector.

        Five directions are compared by their mean height, rounded to 1 cm; of equal ones the
        middle of the sector comes first.

        Args:
            observation: the terrain.
            sector_azimuth: middle of the sector [rad], map frame.
        """
        half = self._params.dig_sector_half_width
        azimuths = sector_azimuth + half * np.array([0.0, -1.0, 1.0, -0.5, 0.5])
        radius = np.linspace(self._params.min_radius, self._params.max_radius, 20)
        heights = [
            observation.mean_strip_heights(azimuth, radius, self._bucket.width).mean()
            for azimuth in azimuths
        ]
        return float(azimuths[int(np.argmax(np.round(heights, 2)))])

    def surface_profile(
        self, observation: Observation, azimuth: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return radius and height of the terrain along the plane of the arm [m], (n,) each."""
        radius = np.arange(self._params.min_radius - 0.5, self._params.max_radius + 0.5, 0.1)
        return radius, observation.mean_strip_heights(azimuth, radius, self._bucket.width)

    def dig_reach(self, observation: Observation, azimuth: float, attitude: float) -> DigReach:
        """Return where the lip can dig if it enters the soil at an attitude [rad].

        Raises:
            ReachError: there is no ground in reach with room for a drag.
        """
        return DigReach(
            min_radius=self._params.min_radius,
            max_radius=self._max_radius(observation, azimuth, attitude),
            min_height=float(observation.base_position[2]) - self._params.max_dig_depth,
            width=self._bucket.width,
            max_cut_depth=self._params.max_cut_depth,
        )

    def swing_clearance_height(self, observation: Observation, start: float, end: float) -> float:
        """Return the height of the pin [m] at which a level bucket clears the ground.

        Args:
            observation: the terrain.
            start: azimuth at which the swing starts [rad].
            end: azimuth at which it ends [rad]; it takes the short way.
        """
        angle = math.remainder(end - start, 2 * math.pi)
        radius = np.linspace(self._params.min_radius, self._params.max_radius, 12)
        max_heights = [
            observation.max_strip_height(start + fraction * angle, radius, 2.0 * self._bucket.width)
            for fraction in np.linspace(0.0, 1.0, 9)
        ]
        return max(max_heights) + self._kinematics.depth_below_pin + self._params.clearance

    def dump_clearance_height(self, observation: Observation, azimuth: float) -> float:
        """Return the height of the pin [m] at which the opening bucket clears the heap below it."""
        length = self._bucket.tip_radius
        pin_radius = self._params.dump_radius
        radius = np.linspace(pin_radius - length, pin_radius + length, 12)
        max_height = observation.max_strip_height(azimuth, radius, 2.0 * self._bucket.width)
        return max_height + length + self._params.clearance

    def _max_radius(self, observation: Observation, azimuth: float, attitude: float) -> float:
        """Return the largest radius at which the lip can be lowered to the maximum depth [m].

        Raises:
            ReachError: there is none with room for a drag.
        """
        params = self._params
        profile_radius, surface = self.surface_profile(observation, azimuth)
        for radius in np.arange(params.max_radius, params.min_radius + 1.0, -0.1).tolist():
            ground = float(np.interp(radius, profile_radius, surface))
            with suppress(ReachError):
                for offset in (params.clearance, -params.max_cut_depth):
                    pose = self._kinematics.pose_with_lip_at(
                        azimuth, radius, ground + offset, attitude
                    )
                    self._kinematics.joint_angles(observation, pose)
                return float(radius)
        raise ReachError(
            f"in direction {math.degrees(azimuth):.0f} deg no ground from {params.min_radius} to"
            f" {params.max_radius} m can be dug from here; move the machine, or change min_radius"
            " and max_radius"
        )
