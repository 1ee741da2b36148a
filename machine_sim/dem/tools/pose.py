"""Poses and twists of rigid bodies: validation, packed records for kernels, and interpolation.

A packed pose is a record of `POSE_SIZE` numbers: the rotation from the body's axes to map axes,
row-major, from slot `XX`, then the origin of the body's frame in the map frame [m] from slot
`ORIGIN`. A packed twist has `TWIST_SIZE` numbers: the velocity of that origin [m/s] from slot
`LINEAR` and the angular velocity [rad/s] from slot `ANGULAR`, both in map axes. A packed wrench has
the force [N] and the torque about the origin [N m] in the same slots.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleError
from msg_bridge.kernels import fixed_signature_kernel, helper, kernel

__all__ = [
    "ANGULAR",
    "LINEAR",
    "ORIGIN",
    "POSE_SIZE",
    "TWIST_SIZE",
    "XX",
    "XY",
    "XZ",
    "YX",
    "YY",
    "YZ",
    "ZX",
    "ZY",
    "ZZ",
    "Pose",
    "interpolate_poses",
    "is_moving",
    "pack_motion",
    "rotate_to_map_axes",
    "rotate_to_tool_axes",
    "to_tool_frame",
    "unpack_pose",
    "velocity_at",
]

XX, XY, XZ, YX, YY, YZ, ZX, ZY, ZZ = range(9)
"""Slots of the rotation in a packed pose: YZ is the y component, in map axes, of the body's z
axis."""
ORIGIN = 9
"""First of three slots of the origin in a packed pose."""
POSE_SIZE = 12
"""Numbers in a packed pose."""

LINEAR, ANGULAR = 0, 3
"""First of three slots of the linear and of the angular part of a packed twist or wrench."""
TWIST_SIZE = 6
"""Numbers in a packed twist or wrench."""

_LARGE_ROTATION, _NOT_A_ROTATION, _NOT_FINITE = 1, 2, 3
_ERRORS = {
    _LARGE_ROTATION: "a tool rotates by 90 deg or more in one step; use shorter steps",
    _NOT_A_ROTATION: "the matrix of a tool pose is no rotation; give the unit axes of a"
    " right-handed frame as columns",
    _NOT_FINITE: "a tool pose is not finite; give the last valid pose instead",
}
_ROTATION_TOLERANCE = 1e-6
"""Maximum error of the lengths and of the dot products of a rotation's axes."""

_MAX_REST_TWIST = 1e-6
"""Maximum component of the twist of a body at rest [m/s, rad/s]."""

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Pose of a tool frame in the map frame: its axes as columns, (3, 3), and its origin [m], (3,)."""


def pack_motion(start: Pose, end: Pose, records: NDArray[np.float64]) -> None:
    """Write two poses, between which a tool can move in a step, into records.

    Args:
        start, end: the poses.
        records: out, packed poses, shape (2, POSE_SIZE).

    Raises:
        ParticleError: wrong shapes, values that are not finite, a matrix that is no rotation, or a
            rotation by 90 degrees or more; nothing was written.
    """
    error = _pack_motion(*_as_arrays(start), *_as_arrays(end), records[0], records[1])
    if error:
        raise ParticleError(_ERRORS[error])


def unpack_pose(record: NDArray[np.float64]) -> Pose:
    """Return the pose of a record as views of it."""
    return record[XX:ORIGIN].reshape(3, 3), record[ORIGIN:POSE_SIZE]


def _as_arrays(pose: Pose) -> Pose:
    """Return a pose as float64.

    Raises:
        ParticleError: wrong shapes.
    """
    rotation = np.asarray(pose[0], np.float64, "C")
    position = np.asarray(pose[1], np.float64, "C")
    if rotation.shape != (3, 3) or position.shape != (3,):
        raise ParticleError(
            f"a pose is a 3 x 3 rotation and a position of 3 coordinates, not {rotation.shape} and"
            f" {position.shape}"
        )
    return rotation, position


@fixed_signature_kernel
def _pack_motion(start, start_position, end, end_position, start_record, end_record):  # type: ignore[no-untyped-def]
    """Pack the poses of a motion, or return its error code; 0 if it is valid."""
    error = max(_pose_error(start, start_position), _pose_error(end, end_position))
    if error:
        return error
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += start[i, j] * end[i, j]
    if 0.5 * (trace - 1.0) <= 0.0:
        return _LARGE_ROTATION
    for i in range(3):
        for j in range(3):
            start_record[3 * i + j], end_record[3 * i + j] = start[i, j], end[i, j]
        start_record[ORIGIN + i], end_record[ORIGIN + i] = start_position[i], end_position[i]
    return 0


@helper
def _pose_error(rotation, position):  # type: ignore[no-untyped-def]
    """Return the error code of a pose, 0 if it is valid.

    Rows, and so columns, must be unit axes of a right-handed frame.
    """
    for i in range(3):
        for j in range(3):
            if not np.isfinite(rotation[i, j]):
                return _NOT_FINITE
        if not np.isfinite(position[i]):
            return _NOT_FINITE
    max_error = 0.0
    for i in range(3):
        for j in range(i, 3):
            dot = 0.0
            for k in range(3):
                dot += rotation[i, k] * rotation[j, k]
            max_error = max(max_error, abs(dot - 1.0 if i == j else dot))
    # The third axis is the first crossed with the second.
    for k in range(3):
        m, n = (k + 1) % 3, (k + 2) % 3
        cross = rotation[0, m] * rotation[1, n] - rotation[0, n] * rotation[1, m]
        max_error = max(max_error, abs(cross - rotation[2, k]))
    return 0 if max_error < _ROTATION_TOLERANCE else _NOT_A_ROTATION


@helper(allocates=True)
def interpolate_poses(start, end, dt, path, twist):  # type: ignore[no-untyped-def]
    """Interpolate from `start` to `end` at constant velocity and angular velocity.

    Args:
        start, end: packed poses, shape (tools, POSE_SIZE).
        dt: time from start to end [s].
        path: out, packed poses, shape (substeps + 1, tools, POSE_SIZE).
        twist: out, packed twists, shape (tools, TWIST_SIZE).
    """
    substeps = path.shape[0] - 1
    rotation_change = np.zeros(9)
    for t in range(start.shape[0]):
        ux, uy, uz, sine, angle = _axis_times_sine(start[t], end[t], rotation_change)
        factor = angle / sine if sine > 1e-12 else 1.0
        for k in range(3):
            twist[t, LINEAR + k] = (end[t, ORIGIN + k] - start[t, ORIGIN + k]) / dt
        twist[t, ANGULAR] = ux * factor / dt
        twist[t, ANGULAR + 1] = uy * factor / dt
        twist[t, ANGULAR + 2] = uz * factor / dt
        if sine > 1e-12:
            ux, uy, uz = ux / sine, uy / sine, uz / sine
        for s in range(substeps + 1):
            fraction = s / substeps
            c, sn = np.cos(angle * fraction), np.sin(angle * fraction)
            # Rodrigues' formula, applied to each axis of the start pose.
            for j in range(3):
                x, y, z = start[t, XX + j], start[t, YX + j], start[t, ZX + j]
                along = (ux * x + uy * y + uz * z) * (1.0 - c)
                path[s, t, XX + j] = x * c + (uy * z - uz * y) * sn + ux * along
                path[s, t, YX + j] = y * c + (uz * x - ux * z) * sn + uy * along
                path[s, t, ZX + j] = z * c + (ux * y - uy * x) * sn + uz * along
                displacement = twist[t, LINEAR + j] * dt * fraction
                path[s, t, ORIGIN + j] = start[t, ORIGIN + j] + displacement
        # The last pose is exactly the given one, so that the next step starts from it.
        for k in range(POSE_SIZE):
            path[substeps, t, k] = end[t, k]


@helper
def _axis_times_sine(start, end, rotation_change):  # type: ignore[no-untyped-def]
    """Return the rotation axis times the sine of the angle, the sine, and the angle [rad].

    Args:
        start, end: packed poses.
        rotation_change: working memory, shape (9,).
    """
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += end[3 * i + k] * start[3 * j + k]
            rotation_change[3 * i + j] = total
    ux = 0.5 * (rotation_change[ZY] - rotation_change[YZ])
    uy = 0.5 * (rotation_change[XZ] - rotation_change[ZX])
    uz = 0.5 * (rotation_change[YX] - rotation_change[XY])
    sine = np.sqrt(ux * ux + uy * uy + uz * uz)
    trace = rotation_change[XX] + rotation_change[YY] + rotation_change[ZZ]
    return ux, uy, uz, sine, np.arctan2(sine, 0.5 * (trace - 1.0))


@helper(forceinline=True)
def to_tool_frame(pose, x, y, z):  # type: ignore[no-untyped-def]
    """Transform a point [m] from the map frame to the frame of a packed pose."""
    return rotate_to_tool_axes(pose, x - pose[ORIGIN], y - pose[ORIGIN + 1], z - pose[ORIGIN + 2])


@helper(forceinline=True)
def rotate_to_tool_axes(pose, x, y, z):  # type: ignore[no-untyped-def]
    """Rotate a vector from map axes to the axes of a packed pose."""
    return (
        pose[XX] * x + pose[YX] * y + pose[ZX] * z,
        pose[XY] * x + pose[YY] * y + pose[ZY] * z,
        pose[XZ] * x + pose[YZ] * y + pose[ZZ] * z,
    )


@helper(forceinline=True)
def rotate_to_map_axes(pose, x, y, z):  # type: ignore[no-untyped-def]
    """Rotate a vector from the axes of a packed pose to map axes."""
    return (
        pose[XX] * x + pose[XY] * y + pose[XZ] * z,
        pose[YX] * x + pose[YY] * y + pose[YZ] * z,
        pose[ZX] * x + pose[ZY] * y + pose[ZZ] * z,
    )


@kernel(forceinline=True)
def velocity_at(twist, x, y, z):  # type: ignore[no-untyped-def]
    """Return the velocity [m/s], map axes, of a body at an offset [m] from its frame origin.

    Args:
        twist: packed twist of the body.
        x, y, z: offset, map axes.
    """
    wx, wy, wz = twist[ANGULAR], twist[ANGULAR + 1], twist[ANGULAR + 2]
    return (
        twist[LINEAR] + wy * z - wz * y,
        twist[LINEAR + 1] + wz * x - wx * z,
        twist[LINEAR + 2] + wx * y - wy * x,
    )


@helper
def is_moving(twist):  # type: ignore[no-untyped-def]
    """Return whether a body of a packed twist is not at rest."""
    largest = 0.0
    for k in range(TWIST_SIZE):
        largest = max(largest, abs(twist[k]))
    return largest > _MAX_REST_TWIST
