"""Poses of rigid bodies: checked, packed for kernels, and the way from one to the next.

Packed, a pose is 12 numbers: the rotation from the body's axes to the map's by rows, then the
origin [m].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleError
from msg_bridge.kernels import kernel

__all__ = [
    "Pose",
    "interpolate_poses",
    "pack_pose",
    "rotate_to_tool_axes",
    "rotation_cosine",
    "to_tool_frame",
    "validate_pose",
]

_NOT_FINITE, _NOT_A_ROTATION = 1, 2
_ROTATION_TOLERANCE = 1e-6
"""How far axes may be from unit ones, and from right angles."""

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Where a tool frame is in the map frame: its axes as columns, (3, 3), and its origin [m], (3,)."""


def validate_pose(pose: Pose) -> Pose:
    """A copy of a pose, in float64.

    Raises:
        ParticleError: wrong shapes, not finite, or no rotation.
    """
    rotation = np.array(pose[0], dtype=np.float64)
    position = np.array(pose[1], dtype=np.float64)
    if rotation.shape != (3, 3) or position.shape != (3,):
        raise ParticleError("a pose is a 3 x 3 rotation and a position of 3 coordinates")
    fault = _pose_error(rotation, position)
    if fault == _NOT_FINITE:
        raise ParticleError("a tool pose is not finite; hold the last one")
    if fault == _NOT_A_ROTATION:
        raise ParticleError("a tool pose has no rotation; give unit axes as columns")
    return rotation, position


@kernel
def _pose_error(rotation, position):  # type: ignore[no-untyped-def]
    """What is wrong with a pose, 0 if nothing.

    Rows, and so columns, must be unit axes of a right-handed frame. A kernel: it is asked four
    times a tick, and NumPy's calls take longer than all of it.
    """
    for i in range(3):
        for j in range(3):
            if not np.isfinite(rotation[i, j]):
                return _NOT_FINITE
        if not np.isfinite(position[i]):
            return _NOT_FINITE
    off = 0.0
    for i in range(3):
        for j in range(i, 3):
            along = 0.0
            for k in range(3):
                along += rotation[i, k] * rotation[j, k]
            off = max(off, abs(along - 1.0 if i == j else along))
    # The third axis is the first crossed with the second.
    for k in range(3):
        m, n = (k + 1) % 3, (k + 2) % 3
        cross = rotation[0, m] * rotation[1, n] - rotation[0, n] * rotation[1, m]
        off = max(off, abs(cross - rotation[2, k]))
    return 0 if off < _ROTATION_TOLERANCE else _NOT_A_ROTATION


@kernel
def rotation_cosine(start, end):  # type: ignore[no-untyped-def]
    """Cosine of the angle between two rotations."""
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += start[i, j] * end[i, j]
    return 0.5 * (trace - 1.0)


def pack_pose(pose: Pose, into: NDArray[np.float64]) -> None:
    """Pack a pose into an array of shape (12,)."""
    into[:9] = pose[0].ravel()
    into[9:] = pose[1]


@kernel
def interpolate_poses(start, end, dt, path, twist):  # type: ignore[no-untyped-def]
    """Poses on the way from `start` to `end` at constant velocity and angular velocity.

    Args:
        start, end: packed poses, shape (tools, 12).
        dt: time from start to end [s].
        path: out, shape (substeps + 1, tools, 12).
        twist: out, velocity and angular velocity, map axes, shape (tools, 6).
    """
    substeps = path.shape[0] - 1
    rotation_change = np.zeros(9)
    for t in range(start.shape[0]):
        for i in range(3):
            for j in range(3):
                total = 0.0
                for k in range(3):
                    total += end[t, 3 * i + k] * start[t, 3 * j + k]
                rotation_change[3 * i + j] = total
        # Axis times sine of the turn; its length and the trace give the angle.
        ux, uy, uz = (
            0.5 * (rotation_change[7] - rotation_change[5]),
            0.5 * (rotation_change[2] - rotation_change[6]),
            0.5 * (rotation_change[3] - rotation_change[1]),
        )
        sine = np.sqrt(ux * ux + uy * uy + uz * uz)
        angle = np.arctan2(
            sine, 0.5 * (rotation_change[0] + rotation_change[4] + rotation_change[8] - 1.0)
        )
        factor = angle / sine if sine > 1e-12 else 1.0
        for k in range(3):
            twist[t, k] = (end[t, 9 + k] - start[t, 9 + k]) / dt
        twist[t, 3], twist[t, 4], twist[t, 5] = ux * factor / dt, uy * factor / dt, uz * factor / dt
        if sine > 1e-12:
            ux, uy, uz = ux / sine, uy / sine, uz / sine
        for s in range(substeps + 1):
            fraction = s / substeps
            c, sn = np.cos(angle * fraction), np.sin(angle * fraction)
            for j in range(3):
                x, y, z = start[t, j], start[t, 3 + j], start[t, 6 + j]
                along = (ux * x + uy * y + uz * z) * (1.0 - c)
                path[s, t, j] = x * c + (uy * z - uz * y) * sn + ux * along
                path[s, t, 3 + j] = y * c + (uz * x - ux * z) * sn + uy * along
                path[s, t, 6 + j] = z * c + (ux * y - uy * x) * sn + uz * along
                path[s, t, 9 + j] = start[t, 9 + j] + twist[t, j] * dt * fraction
        # The end is the end as given, so that the next step starts without a seam.
        for k in range(12):
            path[substeps, t, k] = end[t, k]


@kernel(forceinline=True)
def to_tool_frame(pose, x, y, z):  # type: ignore[no-untyped-def]
    """A point [m] of the map frame in the frame of a packed pose."""
    return rotate_to_tool_axes(pose, x - pose[9], y - pose[10], z - pose[11])


@kernel(forceinline=True)
def rotate_to_tool_axes(pose, x, y, z):  # type: ignore[no-untyped-def]
    """A vector of map axes in the axes of a packed pose."""
    return (
        pose[0] * x + pose[3] * y + pose[6] * z,
        pose[1] * x + pose[4] * y + pose[7] * z,
        pose[2] * x + pose[5] * y + pose[8] * z,
    )
