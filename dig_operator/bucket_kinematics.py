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
from machine_sim.machine.arm_kernels import NO_FAULT, remainder, solve_pin_angles
from machine_sim.machine.arm_kinematics import (
    arm_geometry,
    boxed_arm,
    solve_bucket_pin_angles,
    tool_pose,
)
from machine_sim.machine.errors import ReachError
from machine_sim.machine.rotated_vectors import product_column, rotate_to_map
from machine_sim.machine.rotations import rotation_about_z
from machine_sim.machine.spec import MachineSpec
from msg_bridge.kernels import fixed_signature_kernel, helper

__all__ = ["BucketKinematics", "BucketPose"]

Array = NDArray[np.float64]

_RADIUS_OFFSETS = (0.0, 0.02, -0.02, 0.05, -0.05, 0.1, -0.1, 0.2, -0.2, 0.3, -0.3)
"""Reductions of the radius tried in this order for a pin that is out of reach [m]."""

_LIMIT_TOLERANCE = 0.02
"""Distance from its limit at which a joint counts as at it [rad]."""


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
        self._machine, self._arm = machine, boxed_arm(machine)
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
        self._open_angle = machine.joints["bucket"].lower + _LIMIT_TOLERANCE
        self._floor_angle = math.atan2(z0 - z1, x0 - x1)

    def warm_up(self) -> None:
        """Compile the kernels of `joint_angles`, or load them, before the first tick."""
        _joint_angles(self._arm, np.zeros(3), np.eye(3), 0.0, 0.0, 0.0, 0.0, 0.0, np.empty(4))
        with suppress(ReachError):
            solve_bucket_pin_angles(self._machine, 0.0, 0.0)

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
        angles = np.empty(4)
        azimuth, radius, height, attitude = map(float, pose)  # a kernel would truncate after ints
        is_reached, *pin = _joint_angles(
            self._arm,
            observation.base_position,
            observation.base_rotation,
            float(observation.joints[0]),
            azimuth,
            radius,
            height,
            attitude,
            angles,
        )
        if not is_reached:
            solve_bucket_pin_angles(self._machine, *pin)  # raises the error
        return angles

    def is_bucket_open(self, observation: Observation) -> bool:
        """Return whether the bucket is open as far as its joint allows."""
        return float(observation.joints[3]) <= self._open_angle

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


def _nose_up_angle(upper_rotation: list[list[float]]) -> float:
    """Return the pitch [rad], nose up positive, of a body with a rotation to the map (3, 3)."""
    return math.asin(max(-1.0, min(1.0, upper_rotation[2][0])))


@fixed_signature_kernel
def _joint_angles(  # type: ignore[no-untyped-def]
    boxed_arm, position, rotation, swing_now, azimuth, radius, height, attitude, angles
):
    """Compute `BucketKinematics.joint_angles`.

    Args:
        boxed_arm: `ArmTable`, boxed.
        position, rotation: pose of the base.
        swing_now: present angle of the swing joint [rad].
        azimuth, radius, height, attitude: of the `BucketPose`.
        angles: out, joint angles [rad], shape (4,).

    Returns:
        Whether the pin is in reach, and where it would be without a reduction of the radius: reach
        and height in the swing frame [m].
    """
    geometry = boxed_arm.table
    first_reach, first_height = 0.0, 0.0
    for k in range(len(_RADIUS_OFFSETS)):
        is_reached, reach, pin_height = _solve_joint_angles(
            geometry,
            position,
            rotation,
            swing_now,
            (azimuth, radius - _RADIUS_OFFSETS[k], height, attitude),
            angles,
        )
        if is_reached:
            return True, reach, pin_height
        if k == 0:
            first_reach, first_height = reach, pin_height
    return False, first_reach, first_height


@helper
def _solve_joint_angles(geometry, position, rotation, swing_now, pose, angles):  # type: ignore[no-untyped-def]
    """Compute the joint angles for one radius; arguments and results as for `_joint_angles`."""
    azimuth, radius, height, attitude = pose
    x, y, z = geometry.swing
    offset_x, offset_y, offset_z = rotate_to_map(rotation, x, y, z)
    axis_x, axis_y, axis_z = position[0] + offset_x, position[1] + offset_y, position[2] + offset_z
    # From the swing axis to the pin, rounded as the position of the pin is.
    pin = (
        axis_x + radius * math.cos(azimuth) - axis_x,
        axis_y + radius * math.sin(azimuth) - axis_y,
        height - axis_z,
    )
    x = _dot(pin, (rotation[0, 0], rotation[1, 0], rotation[2, 0]))
    y = _dot(pin, (rotation[0, 1], rotation[1, 1], rotation[2, 1]))
    # Of the equivalent swing angles, whole turns apart, the one nearest to the present one.
    swing = swing_now + remainder(math.atan2(y, x) - swing_now, 2.0 * math.pi)
    ahead = product_column(rotation, math.cos(swing), math.sin(swing), 0.0)
    up = product_column(rotation, 0.0, 0.0, 1.0)
    reach, pin_height = _dot(pin, ahead), _dot(pin, up)
    fault, boom, arm = solve_pin_angles(geometry, reach, pin_height)
    nose_up = math.asin(max(-1.0, min(1.0, ahead[2])))
    lower, upper = geometry.bucket_limits
    angles[0], angles[1], angles[2] = swing, boom, arm
    angles[3] = min(max(attitude + nose_up - boom - arm, lower), upper)
    return fault == NO_FAULT, reach, pin_height


@helper
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
