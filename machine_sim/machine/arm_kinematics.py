"""Closed-form kinematics of the arm: pure functions of the description, no physics engine.

The arm moves in a plane that turns with the swing. In the swing frame (the `upper` link: origin on
the swing axis at the swing bearing, x along the arm, z up) that plane is y = 0, so a tool pose is
reach r [m] from the swing axis, height z [m] above the bearing, and attitude [rad]: the angle of
the line from bucket pin to cutting lip below the horizontal, the sum of the three joint angles.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.errors import MachineError, ReachError
from machine_sim.machine.rotations import rotation_about_z
from machine_sim.machine.spec import MachineSpec

__all__ = [
    "EXCAVATOR_JOINTS",
    "ArmAngles",
    "ArmGeometry",
    "ToolPoint",
    "arm_geometry",
    "map_to_swing_frame",
    "solve_arm_angles",
    "solve_bucket_pin_angles",
    "swing_angle_toward",
    "swing_frame_to_map",
    "tool_point",
    "tool_pose",
]

Array = NDArray[np.float64]

_LIMIT_TOLERANCE = 1e-9
"""Rounding by which an angle may seem beyond its limit [rad]."""


EXCAVATOR_JOINTS = ("swing", "boom", "arm", "bucket")
"""The joints of a machine whose arm is known here, from the base to the tool."""


class ArmGeometry(NamedTuple):
    """What of an excavator its arm's kinematics follow from.

    Attributes:
        swing: swing bearing in the base frame [m].
        foot: boom pin in the upper frame, forward and up [m].
        boom, arm, bucket: lengths pin to pin, and pin to lip [m].
    """

    swing: tuple[float, float, float]
    foot: tuple[float, float]
    boom: float
    arm: float
    bucket: float

    @property
    def lengths(self) -> tuple[float, float, float]:
        """Of boom, arm and bucket [m]."""
        return self.boom, self.arm, self.bucket


@lru_cache(maxsize=16)
def arm_geometry(spec: MachineSpec) -> ArmGeometry:
    """The arm of an excavator.

    Raises:
        MachineError: other joints than `EXCAVATOR_JOINTS`, or an arm that is not in the plane
            y = 0 of a swing about the base's middle.
    """
    if spec.joint_names != EXCAVATOR_JOINTS:
        raise MachineError(
            f"a {spec.name} has joints {', '.join(spec.joint_names)}; give a machine"
            f" with {', '.join(EXCAVATOR_JOINTS)}"
        )
    swing, boom, arm, bucket = spec.joints.values()
    straight = boom.origin[1] == 0.0 and all(
        joint.origin[1:] == (0.0, 0.0) for joint in (arm, bucket)
    )
    axes = (swing.axis, boom.axis, arm.axis, bucket.axis) == ("z", "y", "y", "y")
    if not (straight and axes and swing.origin[:2] == (0.0, 0.0)):
        raise MachineError(
            "an excavator's swing turns about the base frame's z axis, its arm's joints about y, in"
            " the plane y = 0 and each on the x axis of the link before it: change the origins"
        )
    lengths = (arm.origin[0], bucket.origin[0], spec.bucket.tip_radius)
    return ArmGeometry(swing.origin, (boom.origin[0], boom.origin[2]), *lengths)


class ArmAngles(NamedTuple):
    """Joint angles of the arm [rad]."""

    boom: float
    arm: float
    bucket: float


class ToolPoint(NamedTuple):
    """Cutting lip in the arm plane: reach and height in the swing frame [m], attitude [rad]."""

    reach: float
    height: float
    attitude: float


def tool_point(spec: MachineSpec, boom: float, arm: float, bucket: float) -> ToolPoint:
    """Where the middle of the cutting lip is for given joint angles [rad]."""
    geometry = arm_geometry(spec)
    r, z = geometry.foot
    angle = 0.0
    for length, joint in zip(geometry.lengths, (boom, arm, bucket), strict=True):
        angle += joint
        r += length * math.cos(angle)
        z -= length * math.sin(angle)
    return ToolPoint(r, z, angle)


def solve_arm_angles(spec: MachineSpec, reach: float, height: float, attitude: float) -> ArmAngles:
    """Joint angles [rad] that put the cutting lip at (reach, height) with the given attitude.

    The arm folds one way only, so there is one solution at most.

    Raises:
        ReachError: the point is too far or too near, or a joint would pass its limit.
    """
    if not all(map(math.isfinite, (reach, height, attitude))):
        raise ReachError(
            f"reach {reach}, height {height}, attitude {attitude}: give finite numbers"
        )
    third = arm_geometry(spec).bucket
    boom, arm = solve_bucket_pin_angles(
        spec, reach - third * math.cos(attitude), height + third * math.sin(attitude)
    )
    angles = [boom, arm, _wrap_angle(attitude - boom - arm)]
    angles[2] = _within_limits(spec, "bucket", angles[2])
    return ArmAngles(*angles)


def solve_bucket_pin_angles(spec: MachineSpec, reach: float, height: float) -> tuple[float, float]:
    """Boom and arm angles [rad] that put the bucket's pin at (reach, height) in the arm plane [m].

    Raises:
        ReachError: the point is too far or too near, or a joint would pass its limit.
    """
    geometry = arm_geometry(spec)
    first, second = geometry.boom, geometry.arm
    r, z = reach - geometry.foot[0], height - geometry.foot[1]
    cosine = (r * r + z * z - first * first - second * second) / (2.0 * first * second)
    if not -1.0 <= cosine <= 1.0:
        raise ReachError(
            f"the bucket's pin would be {math.hypot(r, z):.2f} m from the boom's foot; the arm"
            f" reaches from {abs(first - second):.2f} to {first + second:.2f} m: move the target"
        )
    arm = math.acos(cosine)
    boom = math.atan2(-z, r) - math.atan2(second * math.sin(arm), first + second * cosine)
    return (
        _within_limits(spec, "boom", _wrap_angle(boom)),
        _within_limits(spec, "arm", arm),
    )


def tool_pose(
    spec: MachineSpec,
    base_position: ArrayLike,
    base_rotation: Array,
    joints: ArrayLike,
) -> tuple[Array, Array]:
    """Pose of the bucket frame in the map frame.

    Args:
        description: the machine.
        base_position: origin of `base_link` [m], shape (3,), map frame.
        base_rotation: `base_link` to map, shape (3, 3).
        joints: swing, boom, arm, bucket [rad].

    Returns:
        Rotation bucket to map, shape (3, 3), and origin (the bucket's pin) [m], shape (3,).
    """
    swing, boom, arm, bucket = np.asarray(joints, dtype=np.float64)
    tip = tool_point(spec, boom, arm, bucket)
    third = arm_geometry(spec).bucket
    s, c = math.sin(tip.attitude), math.cos(tip.attitude)
    upper = base_rotation @ rotation_about_z(swing)
    pin = np.array([tip.reach - third * c, 0.0, tip.height + third * s])
    origin = base_position + base_rotation @ np.array(arm_geometry(spec).swing) + upper @ pin
    rotation = upper @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return rotation, origin


def map_to_swing_frame(
    spec: MachineSpec,
    base_position: ArrayLike,
    base_rotation: Array,
    swing: float,
    points: ArrayLike,
) -> Array:
    """Points of the map frame in the swing frame.

    Args:
        description, base_position, base_rotation: as in `tool_pose`.
        swing: swing angle [rad].
        points: map frame [m], shape (3,) or (n, 3).

    Returns:
        (reach, sideways, height) [m], same shape; sideways is the distance off the arm plane.
    """
    rotation, origin = _swing_frame(spec, base_position, base_rotation, swing)
    local = (np.asarray(points, dtype=np.float64) - origin) @ rotation
    return np.asarray(local, dtype=np.float64)


def swing_frame_to_map(
    spec: MachineSpec,
    base_position: ArrayLike,
    base_rotation: Array,
    swing: float,
    points: ArrayLike,
) -> Array:
    """Points (reach, sideways, height) of the swing frame in the map frame: `map_to_swing_frame` back."""
    rotation, origin = _swing_frame(spec, base_position, base_rotation, swing)
    mapped = np.asarray(points, dtype=np.float64) @ rotation.T + origin
    return np.asarray(mapped, dtype=np.float64)


def swing_angle_toward(
    spec: MachineSpec,
    base_position: ArrayLike,
    base_rotation: Array,
    point: ArrayLike,
) -> float:
    """Swing angle [rad], -pi to pi, at which the arm plane holds a point of the map frame [m].

    Arguments as in `map_to_swing_frame`; the base may stand on a slope.
    """
    x, y, _ = map_to_swing_frame(spec, base_position, base_rotation, 0.0, point)
    return math.atan2(y, x)


def _swing_frame(
    spec: MachineSpec, base_position: ArrayLike, base_rotation: Array, swing: float
) -> tuple[Array, Array]:
    """Rotation swing frame to map and origin [m]."""
    origin = base_position + base_rotation @ np.array(arm_geometry(spec).swing)
    return base_rotation @ rotation_about_z(swing), origin


def _within_limits(spec: MachineSpec, name: str, angle: float) -> float:
    limits = spec.joints[name]
    if not limits.lower - _LIMIT_TOLERANCE <= angle <= limits.upper + _LIMIT_TOLERANCE:
        raise ReachError(
            f"{name} would be at {angle:.3f} rad, its limits are {limits.lower} and"
            f" {limits.upper}: move the target or change its attitude"
        )
    return min(max(angle, limits.lower), limits.upper)


def _wrap_angle(angle: float) -> float:
    """The same angle in -pi to pi."""
    return math.remainder(angle, 2.0 * math.pi)
