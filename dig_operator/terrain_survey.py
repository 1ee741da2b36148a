"""TerrainSurvey: where to dig, and how high to swing and to dump.

It evaluates the observed terrain and, for the motion in the air, the other machines.
"""

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

_NUM_SWING_AZIMUTHS = 9
"""Azimuths along a swing at which the heights of ground and machines are taken."""


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

    def swing_clearance_heights(
        self, observation: Observation, start: float, end: float, depth: float
    ) -> NDArray[np.float64]:
        """Return heights of the pin [m] along a swing that keep the bucket clear, shape (n,).

        They clear the ground and the other machines near each of n equidistant azimuths, and near
        the two beside it, so that the straight lines between them clear what is between.

        Args:
            observation: the terrain and the other machines.
            start: azimuth at which the swing starts [rad].
            end: azimuth at which it ends [rad]; it takes the short way.
            depth: height of the pin above the bucket's lowest point [m].
        """
        angle = math.remainder(end - start, 2 * math.pi)
        radius = np.linspace(self._params.min_radius, self._params.max_radius, 12)
        azimuths = start + angle * np.linspace(0.0, 1.0, _NUM_SWING_AZIMUTHS)
        width = 2.0 * self._bucket.width
        tip = self._bucket.tip_radius
        near, far = self._params.min_radius - tip, self._params.max_radius + tip
        heights = np.array(
            [
                max(
                    observation.max_strip_height(azimuth, radius, width),
                    _max_machine_height(observation, azimuth, width, near, far),
                )
                for azimuth in azimuths
            ]
        )
        padded = np.pad(heights, 1, mode="edge")
        near_heights = np.maximum(np.maximum(padded[:-2], padded[2:]), heights)
        return np.asarray(near_heights + depth + self._params.clearance)

    def ground_height_near(self, observation: Observation, azimuth: float) -> float:
        """Return the maximum height of the ground between the machine and its reach [m].

        Args:
            observation: the terrain.
            azimuth: direction from the machine [rad].
        """
        radius = np.linspace(0.0, self._params.min_radius, 12)
        return observation.max_strip_height(azimuth, radius, 2.0 * self._bucket.width)

    def dump_clearance_height(
        self, observation: Observation, azimuth: float, pin_radius: float
    ) -> float:
        """Return the height of the pin [m] at which the opening bucket clears what is below it.

        Args:
            observation: the terrain and the other machines.
            azimuth: direction of the dump [rad].
            pin_radius: radius of the pin [m].
        """
        length, width = self._bucket.tip_radius, 2.0 * self._bucket.width
        radius = np.linspace(pin_radius - length, pin_radius + length, 12)
        max_height = max(
            observation.max_strip_height(azimuth, radius, width),
            _max_machine_height(
                observation, azimuth, width, pin_radius - length, pin_radius + length
            ),
        )
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


def _max_machine_height(
    observation: Observation, azimuth: float, width: float, near: float, far: float
) -> float:
    """Return the maximum height of other machines in a radial strip [m]; -inf if there are none.

    Args:
        observation: the other machines.
        azimuth: direction of the strip [rad], map frame.
        width: width of the strip [m].
        near, far: its ends, distances from the base [m].
    """
    height = -math.inf
    c, s = math.cos(azimuth), math.sin(azimuth)
    for machine in observation.others:
        dx, dy = (machine.points[:, :2] - observation.base_position[:2]).T
        along, across = dx * c + dy * s, dy * c - dx * s
        is_inside = (np.abs(across) <= 0.5 * width) & (near <= along) & (along <= far)
        height = max(height, float(machine.points[is_inside, 2].max(initial=-math.inf)))
    return height
