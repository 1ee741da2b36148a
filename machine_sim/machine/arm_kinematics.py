"""Closed-form kinematics of an excavator's arm, without a physics engine.

The arm moves in a plane that rotates with the swing. In the swing frame (the `upper` link: origin
on the swing axis at the swing bearing, x along the arm, z up) that plane is y = 0. A tool pose is
therefore given by reach r [m] from the swing axis, height z [m] above the bearing, and attitude
[rad]: the angle of the line from bucket pin to cutting lip below the horizontal, which is the sum
of the three joint angles. Joint angles follow the right-hand rule about +y, so that a positive
angle lowers.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.arm_kernels import (
    ARM_LIMIT,
    BOOM_LIMIT,
    LIMIT_TOLERANCE,
    OUT_OF_REACH,
    ArmTable,
    solve_pin_angles,
)
from machine_sim.machine.errors import MachineError, ReachError
from machine_sim.machine.rotations import rotation_about_z
from machine_sim.machine.spec import MachineSpec
from msg_bridge.kernels import BoxedTable, box_table, fixed_signature_kernel

__all__ = [
    "EXCAVATOR_JOINTS",
    "ArmAngles",
    "ArmGeometry",
    "ToolPoint",
    "arm_geometry",
    "boxed_arm",
    "map_to_swing_frame",
    "solve_arm_angles",
    "solve_bucket_pin_angles",
    "swing_angle_toward",
    "swing_frame_to_map",
    "tool_point",
    "tool_pose",
]

Array = NDArray[np.float64]

EXCAVATOR_JOINTS = ("swing", "boom", "arm", "bucket")
"""Joints of an excavator, from the base to the tool."""


class ArmGeometry(NamedTuple):
    """Geometry of an excavator's arm.

    Attributes:
        swing: position of the swing bearing in the base frame [m].
        foot: position of the boom pin in the swing frame, x and z [m].
        boom, arm, bucket: lengths from pin to pin, and from pin to lip [m].
    """

    swing: tuple[float, float, float]
    foot: tuple[float, float]
    boom: float
    arm: float
    bucket: float

    @property
    def lengths(self) -> tuple[float, float, float]:
        """Lengths of boom, arm and bucket [m]."""
        return self.boom, self.arm, self.bucket


@lru_cache(maxsize=16)
def arm_geometry(spec: MachineSpec) -> ArmGeometry:
    """Return the geometry of an excavator's arm.

    Raises:
        MachineError: joints other than `EXCAVATOR_JOINTS`, or an arm that is not in the plane y = 0
            of a swing about the z axis of the base.
    """
    if spec.joint_names != EXCAVATOR_JOINTS:
        raise MachineError(
            f"machine type {spec.name} has joints {', '.join(spec.joint_names)}; choose one with"
            f" {', '.join(EXCAVATOR_JOINTS)}"
        )
    swing, boom, arm, bucket = spec.joints.values()
    is_planar = boom.origin[1] == 0.0 and all(
        joint.origin[1:] == (0.0, 0.0) for joint in (arm, bucket)
    )
    has_axes = (swing.axis, boom.axis, arm.axis, bucket.axis) == ("z", "y", "y", "y")
    if not (is_planar and has_axes and swing.origin[:2] == (0.0, 0.0)):
        raise MachineError(
            "the swing of an excavator rotates about the z axis of the base, its other joints about"
            " y in the plane y = 0, arm and bucket on the x axis of their parents: change axes or"
            " origins"
        )
    lengths = (arm.origin[0], bucket.origin[0], spec.bucket.tip_radius)
    return ArmGeometry(swing.origin, (boom.origin[0], boom.origin[2]), *lengths)


@lru_cache(maxsize=16)
def boxed_arm(spec: MachineSpec) -> BoxedTable:
    """Return the `ArmTable` of an excavator, boxed.

    Raises:
        MachineError: as `arm_geometry`.
    """
    geometry = arm_geometry(spec)
    limits = [(float(joint.lower), float(joint.upper)) for joint in list(spec.joints.values())[1:]]
    swing_x, swing_y, swing_z = map(float, geometry.swing)
    foot_x, foot_z = map(float, geometry.foot)
    return box_table(
        ArmTable(
            (swing_x, swing_y, swing_z),
            foot_x,
            foot_z,
            float(geometry.boom),
            float(geometry.arm),
            *limits,
        )
    )


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
    """Return the position of the cutting lip's middle for given joint angles [rad]."""
    geometry = arm_geometry(spec)
    r, z = geometry.foot
    angle = 0.0
    for length, joint in zip(geometry.lengths, (boom, arm, bucket), strict=True):
        angle += joint
        r += length * math.cos(angle)
        z -= length * math.sin(angle)
    return ToolPoint(r, z, angle)


def solve_arm_angles(spec: MachineSpec, reach: float, height: float, attitude: float) -> ArmAngles:
    """Return the joint angles [rad] that put the cutting lip at a reach, height and attitude.

    The arm folds in one direction only, so there is at most one solution.

    Raises:
        ReachError: the point is too far or too near, or a joint would exceed its limits.
    """
    if not all(map(math.isfinite, (reach, height, attitude))):
        raise ReachError(
            f"reach {reach}, height {height}, attitude {attitude}: give finite numbers"
        )
    length = arm_geometry(spec).bucket
    boom, arm = solve_bucket_pin_angles(
        spec, reach - length * math.cos(attitude), height + length * math.sin(attitude)
    )
    angles = [boom, arm, _wrap_angle(attitude - boom - arm)]
    angles[2] = _within_limits(spec, "bucket", angles[2])
    return ArmAngles(*angles)


def solve_bucket_pin_angles(spec: MachineSpec, reach: float, height: float) -> tuple[float, float]:
    """Return the boom and arm angles [rad] that put the bucket pin at (reach, height) [m].

    Raises:
        ReachError: the point is too far or too near, or a joint would exceed its limits.
    """
    fault, boom, arm = _pin_angles(boxed_arm(spec), float(reach), float(height))
    if fault == OUT_OF_REACH:
        geometry = arm_geometry(spec)
        first, second = geometry.boom, geometry.arm
        distance = math.hypot(reach - geometry.foot[0], height - geometry.foot[1])
        raise ReachError(
            f"the bucket pin would be {distance:.2f} m from the boom pin; the arm reaches"
            f" from {abs(first - second):.2f} to {first + second:.2f} m: move the target"
        )
    if fault == BOOM_LIMIT:
        raise _limit_error(spec, "boom", boom)
    if fault == ARM_LIMIT:
        raise _limit_error(spec, "arm", arm)
    return boom, arm


@fixed_signature_kernel
def _pin_angles(boxed, reach, height):  # type: ignore[no-untyped-def]
    """Run `solve_pin_angles` alone, with a boxed `ArmTable`."""
    return solve_pin_angles(boxed.table, reach, height)


def tool_pose(
    spec: MachineSpec,
    base_position: ArrayLike,
    base_rotation: Array,
    joints: ArrayLike,
) -> tuple[Array, Array]:
    """Return the pose of the bucket frame in the map frame.

    Args:
        spec: specification of the excavator.
        base_position: origin of `base_link` [m], shape (3,), map frame.
        base_rotation: rotation matrix `base_link` to map, shape (3, 3).
        joints: angles of swing, boom, arm and bucket [rad].

    Returns:
        Rotation matrix bucket to map, shape (3, 3), and origin (the bucket pin) [m], shape (3,).
    """
    swing, boom, arm, bucket = np.asarray(joints, dtype=np.float64)
    tip = tool_point(spec, boom, arm, bucket)
    length = arm_geometry(spec).bucket
    s, c = math.sin(tip.attitude), math.cos(tip.attitude)
    upper = base_rotation @ rotation_about_z(swing)
    pin = np.array([tip.reach - length * c, 0.0, tip.height + length * s])
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
    """Transform points from the map frame to the swing frame.

    Args:
        spec, base_position, base_rotation: as in `tool_pose`.
        swing: swing angle [rad].
        points: points [m], map frame, shape (3,) or (n, 3).

    Returns:
        (reach, lateral, height) [m], same shape; lateral is the distance from the arm plane.
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
    """Transform points (reach, lateral, height) [m] from the swing frame to the map frame.

    Arguments as in `map_to_swing_frame`.
    """
    rotation, origin = _swing_frame(spec, base_position, base_rotation, swing)
    mapped = np.asarray(points, dtype=np.float64) @ rotation.T + origin
    return np.asarray(mapped, dtype=np.float64)


def swing_angle_toward(
    spec: MachineSpec,
    base_position: ArrayLike,
    base_rotation: Array,
    point: ArrayLike,
) -> float:
    """Return the swing angle [rad], -pi to pi, at which a point [m] is in the arm plane.

    Arguments as in `map_to_swing_frame`; the base can be inclined.
    """
    x, y, _ = map_to_swing_frame(spec, base_position, base_rotation, 0.0, point)
    return math.atan2(y, x)


def _swing_frame(
    spec: MachineSpec, base_position: ArrayLike, base_rotation: Array, swing: float
) -> tuple[Array, Array]:
    """Return the rotation matrix swing frame to map, and the origin of the swing frame [m]."""
    origin = base_position + base_rotation @ np.array(arm_geometry(spec).swing)
    return base_rotation @ rotation_about_z(swing), origin


def _within_limits(spec: MachineSpec, name: str, angle: float) -> float:
    """Return a joint angle [rad], clamped within rounding errors.

    Raises:
        ReachError: the angle is outside the limits of the joint.
    """
    limits = spec.joints[name]
    if not limits.lower - LIMIT_TOLERANCE <= angle <= limits.upper + LIMIT_TOLERANCE:
        raise _limit_error(spec, name, angle)
    return min(max(angle, limits.lower), limits.upper)


def _limit_error(spec: MachineSpec, name: str, angle: float) -> ReachError:
    """Return the error of a joint that would be at an angle [rad] outside its limits."""
    limits = spec.joints[name]
    return ReachError(
        f"{name} would be at {angle:.3f} rad, outside its limits {limits.lower} to"
        f" {limits.upper} rad: move the target or change its attitude"
    )


def _wrap_angle(angle: float) -> float:
    """Return the equivalent angle in -pi to pi."""
    return math.remainder(angle, 2.0 * math.pi)
