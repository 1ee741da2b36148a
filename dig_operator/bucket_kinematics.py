"""The arm as an operator thinks of it: put the bucket there, at that slant.

Places are given over the map: direction (azimuth) and radius from the swing axis, height above the
map's zero. Slants are attitudes: the angle of the line from pin to lip below the horizontal.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dig_operator.observation import Observation
from machine_sim.machine.arm_kinematics import arm_geometry, solve_bucket_pin_angles, tool_pose
from machine_sim.machine.errors import ReachError
from machine_sim.machine.rotations import rotation_about_z
from machine_sim.machine.spec import MachineSpec

__all__ = ["BucketKinematics", "BucketPose"]

Array = NDArray[np.float64]

_RADIUS_OFFSETS = (0.0, 0.02, -0.02, 0.05, -0.05, 0.1, -0.1, 0.2, -0.2, 0.3, -0.3)
"""How much nearer, or farther out, a pin is tried that is out of reach [m]."""


class BucketPose(NamedTuple):
    """Where a bucket's pin is over the map, and how the bucket slants.

    Attributes:
        azimuth: direction from the swing axis [rad], map frame.
        radius: horizontal distance from the swing axis [m].
        height: above the map's zero [m].
        attitude: angle of the line from pin to lip below the horizontal [rad].
    """

    azimuth: float
    radius: float
    height: float
    attitude: float


class BucketKinematics:
    """Where the bucket of one machine can be put.

    Attributes:
        level: attitude at which the bucket's mouth looks straight up [rad].
        depth_below_pin: how far the bucket reaches below its pin when level [m].
    """

    def __init__(self, machine: MachineSpec) -> None:
        self._machine = machine
        self._swing_offset = np.array(arm_geometry(machine).swing)
        bucket = machine.bucket
        self._tip_length = bucket.tip_radius
        nx, _, nz = bucket.opening_normal
        self.level_attitude = math.atan2(-nx, nz) % (2 * math.pi)
        x, z = bucket.profile.T
        self.depth_below_pin = float(
            (x * math.sin(self.level_attitude) - z * math.cos(self.level_attitude)).max()
        )
        (x0, z0), (x1, z1) = bucket.profile[:2]
        self._floor_angle = math.atan2(z0 - z1, x0 - x1)

    def attitude_for_attack_angle(self, angle: float) -> float:
        """Attitude at which the floor behind the lip slants `angle` [rad] below level.

        The lip points toward the machine; with a positive angle it goes down into the soil.
        """
        return (self._floor_angle - math.pi - angle) % (2 * math.pi)

    def pose_with_lip_at(
        self, azimuth: float, radius: float, height: float, attitude: float
    ) -> BucketPose:
        """The place of the bucket that has its lip at a radius and height [m]."""
        return BucketPose(
            azimuth,
            radius - self._tip_length * math.cos(attitude),
            height + self._tip_length * math.sin(attitude),
            attitude,
        )

    def bucket_pose(self, observation: Observation) -> BucketPose:
        """Where the bucket is seen to be."""
        _, pin = tool_pose(
            self._machine, observation.base_position, observation.base_rotation, observation.joints
        )
        # Over a base that leans sideways the pin is not where the upper body faces.
        x, y, _ = (pin - self._swing_axis(observation)).tolist()
        attitude = float(observation.joints[1:].sum()) - self.nose_up_angle(observation)
        return BucketPose(math.atan2(y, x), math.hypot(x, y), float(pin[2]), attitude)

    def joint_angles(self, observation: Observation, place: BucketPose) -> Array:
        """Joint angles [rad], shape (4,), that put the bucket at a place.

        A bucket joint at its limit leaves the bucket at the nearest slant it can have. A pin a
        little too far out or too near, as when the base rocks, is put where it can be.

        Raises:
            ReachError: the pin cannot be anywhere near there.
        """
        for nearer in _RADIUS_OFFSETS:
            with suppress(ReachError):
                return self._solve_joint_angles(
                    observation, place._replace(radius=place.radius - nearer)
                )
        return self._solve_joint_angles(observation, place)

    def _solve_joint_angles(self, observation: Observation, place: BucketPose) -> Array:
        axis = self._swing_axis(observation)
        east, north = math.cos(place.azimuth), math.sin(place.azimuth)
        target = [axis[0] + place.radius * east, axis[1] + place.radius * north, place.height]
        away = np.array(target) - axis
        x, y, _ = (away @ observation.base_rotation).tolist()
        # The same direction again, whole turns away, as near as can be to where it is.
        now = float(observation.joints[0])
        swing = now + math.remainder(math.atan2(y, x) - now, 2 * math.pi)
        upper = observation.base_rotation @ rotation_about_z(swing)
        reach, _, above = (away @ upper).tolist()
        boom, arm = solve_bucket_pin_angles(self._machine, reach, above)
        limits = self._machine.joints["bucket"]
        wanted = place.attitude + _nose_up_angle(upper) - boom - arm
        bucket = min(max(wanted, limits.lower), limits.upper)
        return np.array([swing, boom, arm, bucket])

    def nose_up_angle(self, observation: Observation) -> float:
        """Angle by which the upper body looks up [rad]; below 0 it leans forward."""
        return _nose_up_angle(
            observation.base_rotation @ rotation_about_z(float(observation.joints[0]))
        )

    def _swing_axis(self, observation: Observation) -> Array:
        return np.asarray(
            observation.base_position + observation.base_rotation @ self._swing_offset,
            dtype=np.float64,
        )


def _nose_up_angle(upper: Array) -> float:
    """Angle at which the upper body looks up [rad], given its rotation to the map."""
    return math.asin(max(-1.0, min(1.0, float(upper[2, 0]))))
