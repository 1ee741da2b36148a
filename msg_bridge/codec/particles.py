"""The particles of a machine as a cloud, for viewers and bags; accounting does not use it."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.rows import MAX_ROW_VOLUME, Rows

__all__ = ["PARTICLE", "from_particle_cloud", "to_particle_cloud"]

PARTICLE = np.dtype(
    [
        ("x", "<f4"),  # centre [m]
        ("y", "<f4"),
        ("z", "<f4"),
        ("vx", "<f4"),  # [m/s]
        ("vy", "<f4"),
        ("vz", "<f4"),
        ("diameter", "<f4"),  # diameter of the sphere [m]
        ("id", "<u4"),
        ("volume_mm3", "<u4"),  # bank volume, exact
        ("soil", "u1"),
    ]
)
"""A point of the particle cloud."""


def to_particle_cloud(
    position: NDArray[np.floating],
    velocity: NDArray[np.floating],
    radius: NDArray[np.floating],
    particle_id: NDArray[np.integer],
    volume_mm3: NDArray[np.integer],
    soil: NDArray[np.integer],
    frame_id: str,
    stamp: Time,
) -> PointCloud2:
    """Encode particles, in the order given.

    Args:
        position, velocity: of the centres [m], [m/s], frame `frame_id`, shape (n, 3).
        radius: radius of the spheres [m], shape (n,).
        particle_id, volume_mm3, soil: number, bank volume [mm^3], soil type; shape (n,).
        frame_id: frame of position and velocity.
        stamp: end of the tick.

    Raises:
        CodecError: SHAPE: arrays of different lengths; VALUE: a volume outside its range.
    """
    count = len(particle_id)
    columns = (radius, particle_id, volume_mm3, soil)
    if any(each.shape != (count, 3) for each in (position, velocity)) or any(
        each.shape != (count,) for each in columns
    ):
        raise CodecError(
            f"position has shape {position.shape}, velocity {velocity.shape} and the others"
            f" {[each.shape for each in columns]}; give one row for each particle",
            ErrorCode.SHAPE,
        )
    if count and not 0 <= volume_mm3.min() <= volume_mm3.max() <= MAX_ROW_VOLUME:
        raise CodecError(
            f"particles have volumes of {volume_mm3.min()} to {volume_mm3.max()} mm^3; give 0 to"
            f" {MAX_ROW_VOLUME} mm^3 (smaller particles)",
            ErrorCode.VALUE,
        )
    rows = np.empty(count, dtype=PARTICLE)
    rows["x"], rows["y"], rows["z"] = position.T
    rows["vx"], rows["vy"], rows["vz"] = velocity.T
    rows["diameter"] = 2.0 * radius
    rows["id"] = particle_id
    rows["volume_mm3"] = volume_mm3
    rows["soil"] = soil
    return to_point_cloud(rows, frame_id, stamp)


def from_particle_cloud(msg: PointCloud2) -> Rows:
    """Decode PARTICLE rows, read-only.

    Raises:
        CodecError: as `from_point_cloud`.
    """
    return from_point_cloud(msg, PARTICLE)
