"""Kinematics of the arm in terms of the bucket: joint angles for a pose of the bucket, and back.

A bucket pose is given in the map frame: azimuth and radius from the swing axis, height above the
map's zero, and attitude. The attitude is the angle of the line from pin to lip below the
horizontal.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dig_operator.observation import Observation
from machine_sim.machine.arm_kinematics import arm_geometry, solve_bucket_pin_angles, tool_pose
from machine_sim.machine.box import Vec3
from machine_sim.machine.errors import ReachError
from machine_sim.machine.rotations import rotation_about_z
from machine_sim.machine.spec import MachineSpec

__all__ = ["BucketKinematics", "BucketPose"]

Array = NDArray[np.float64]

_RADIUS_OFFSETS = (0.0, 0.02, -0.02, 0.05, -0.05, 0.1, -0.1, 0.2, -0.2, 0.3, -0.3)
"""Reductions of the radius tried in this order for a pin that is out of reach [m]."""


class BucketPose(NamedTuple):
    """Pose of a bucket: position of its pin and attitude.

    Attributes:
        azimuth: direction from the swing axis [rad], map frame.
        radius: horizontal distance from the swing axis [m].
        height: height above the map's zero [m].
        attitude: angle of the line from pin to lip below the horizontal [rad].
    """

    azimuth: float
    radius: float
    height: float
    attitude: float


class BucketKinematics:
    """Inverse and forward kinematics of the bucket of one machine.

    Attributes:
        level_attitude: attitude at which the bucket's opening faces straight up [rad].
        depth_below_pin: height of the pin above the bucket's lowest point when level [m].
        tip_length: distance from the pin to the lip [m].
    """

    def __init__(self, machine: MachineSpec) -> None:
        self._machine = machine
        self._swing_offset = np.array(arm_geometry(machine).swing)
        bucket = machine.bucket
        self.tip_length = bucket.tip_radius
        nx, _, nz = bucket.opening_normal
        self.level_attitude = math.atan2(-nx, nz) % (2 * math.pi)
        x, z = bucket.profile.T
        self.depth_below_pin = float(
            (x * math.sin(self.level_attitude) - z * math.cos(self.level_attitude)).max()
        )
        (x0, z0), (x1, z1) = bucket.profile[:2]
        self._floor_angle = math.atan2(z0 - z1, x0 - x1)

    def attitude_for_attack_angle(self, angle: float) -> float:
        """Return the attitude at which the floor behind the lip is `angle` [rad] below level.

        The lip points toward the machine; a positive angle points it down into the soil.
        """
        return (self._floor_angle - math.pi - angle) % (2 * math.pi)

    def pose_with_lip_at(
        self, azimuth: float, radius: float, height: float, attitude: float
    ) -> BucketPose:
        """Return the bucket pose that has the lip at a radius and height [m]."""
        return BucketPose(
            azimuth,
            radius - self.tip_length * math.cos(attitude),
            height + self.tip_length * math.sin(attitude),
            attitude,
        )

    def bucket_pose(self, observation: Observation) -> BucketPose:
        """Return the observed pose of the bucket."""
        _, pin = tool_pose(
            self._machine, observation.base_position, observation.base_rotation, observation.joints
        )
        # On a base that rolls, the azimuth of the pin differs from that of the upper body.
        x, y, _ = (pin - self.swing_axis(observation)).tolist()
        attitude = float(observation.joints[1:].sum()) - self.nose_up_angle(observation)
        return BucketPose(math.atan2(y, x), math.hypot(x, y), float(pin[2]), attitude)

    def joint_angles(self, observation: Observation, pose: BucketPose) -> Array:
        """Return the joint angles [rad], shape (4,), that bring the bucket to a pose.

        The bucket joint is clamped to its limits. A pin slightly out of reach, as when the base
        rocks, is moved along its radius by at most 0.3 m.

        Raises:
            ReachError: the pin cannot be brought near the pose.
        """
        for reduction in _RADIUS_OFFSETS:
            with suppress(ReachError):
                return self._solve_joint_angles(observation, pose, pose.radius - reduction)
        return self._solve_joint_angles(observation, pose, pose.radius)

    def _solve_joint_angles(
        self, observation: Observation, pose: BucketPose, radius: float
    ) -> Array:
        """Return the joint angles for a pose with another radius [m]; see `joint_angles`."""
        axis_x, axis_y, axis_z = self.swing_axis(observation).tolist()
        # From the swing axis to the pin, rounded as the position of the pin is.
        offset = (
            axis_x + radius * math.cos(pose.azimuth) - axis_x,
            axis_y + radius * math.sin(pose.azimuth) - axis_y,
            pose.height - axis_z,
        )
        x, y, _ = _in_frame(offset, observation.base_rotation.tolist())
        # Of the equivalent swing angles, whole turns apart, the one nearest to the present one.
        swing_now = float(observation.joints[0])
        swing = swing_now + math.remainder(math.atan2(y, x) - swing_now, 2 * math.pi)
        upper_rotation = observation.base_rotation.dot(rotation_about_z(swing)).tolist()
        reach, _, height = _in_frame(offset, upper_rotation)
        boom, arm = solve_bucket_pin_angles(self._machine, reach, height)
        limits = self._machine.joints["bucket"]
        bucket = pose.attitude + _nose_up_angle(upper_rotation) - boom - arm
        bucket = min(max(bucket, limits.lower), limits.upper)
        return np.array([swing, boom, arm, bucket])

    def nose_up_angle(self, observation: Observation) -> float:
        """Return the pitch of the upper body [rad]; positive is nose up, negative nose down."""
        swing_rotation = rotation_about_z(float(observation.joints[0]))
        return _nose_up_angle(observation.base_rotation.dot(swing_rotation).tolist())

    def swing_axis(self, observation: Observation) -> Array:
        """Return the origin of the swing joint [m], map frame, shape (3,)."""
        return np.asarray(
            observation.base_position + observation.base_rotation.dot(self._swing_offset),
            dtype=np.float64,
        )


def _in_frame(vector: Vec3, rotation: list[list[float]]) -> Vec3:
    """Return a vector of the map frame in a frame with a rotation to the map (3, 3)."""
    x, y, z = vector
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    return x * xx + y * yx + z * zx, x * xy + y * yy + z * zy, x * xz + y * yz + z * zz


def _nose_up_angle(upper_rotation: list[list[float]]) -> float:
    """Return the pitch [rad], nose up positive, of a body with a rotation to the map (3, 3)."""
    return math.asin(max(-1.0, min(1.0, upper_rotation[2][0])))
