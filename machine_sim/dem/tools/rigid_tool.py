"""A rigid tool made of plates, with its pose at the start and at the end of a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.state import ParticleError
from machine_sim.dem.tools.convex_hull import convex_hull_planes
from machine_sim.dem.tools.plane import PLANE_OFFSET
from machine_sim.dem.tools.plates import Plates
from machine_sim.dem.tools.pose import POSE_SIZE, Pose, pack_motion, unpack_pose

__all__ = ["RigidTool"]


class RigidTool:
    """A tool of thin two-sided plates: a bucket, a blade, the envelope of a cutter drum.

    Attributes:
        plates: its plates, tool frame.
        hull: half-spaces of the convex hull of its corners, tool frame, shape (planes, 4), see
            `tools.plane`.
        centre: centre of its bounding sphere [m], tool frame, shape (3,).
        bounding_radius: radius of its bounding sphere [m].
        is_digging: whether it enters the ground, see `near_tools.classify_near_tools`.
        pushes_ground: whether the ground ahead of it fails, see `contacts.failing_ground`: it digs
            and does not mill.
        records: packed poses at the start and at the end of a step, shape (2, POSE_SIZE); a view of
            those of all tools in a `ToolSet`.
    """

    def __init__(
        self,
        polygons: Sequence[ArrayLike],
        pose: Pose,
        *,
        is_digging: bool = True,
        is_milling: bool = False,
    ) -> None:
        """Build from plates, each (k, 3) corners [m] in the tool frame, in order around it.

        Raises:
            ParticleError: no plate, a plate that is not planar and convex, or an invalid pose.
        """
        if not polygons:
            raise ParticleError("a tool needs at least one plate")
        self.plates = Plates.from_polygons(polygons)
        corners = np.concatenate([np.asarray(p, dtype=np.float64) for p in polygons])
        self.hull = convex_hull_planes(corners)
        self.centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        self.bounding_radius = float(np.linalg.norm(corners - self.centre, axis=1).max())
        self.is_digging = is_digging
        self.pushes_ground = is_digging and not is_milling
        self.records = np.empty((2, POSE_SIZE))
        pack_motion(pose, pose, self.records)

    def move(self, start: Pose, end: Pose) -> None:
        """Set the motion of the next step.

        Raises:
            ParticleError: an invalid pose, or a rotation by 90 degrees or more; nothing was set.
        """
        pack_motion(start, end, self.records)

    @property
    def start(self) -> Pose:
        """Pose at the start of a step; views of its record."""
        return unpack_pose(self.records[0])

    @property
    def end(self) -> Pose:
        """Pose at the end of a step; views of its record."""
        return unpack_pose(self.records[1])

    def to_local_frame(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform points [m], shape (n, 3), from the map frame to the frame at the end pose."""
        return np.asarray((position - self.end[1]) @ self.end[0], dtype=np.float64)

    def contains(self, local: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points [m], shape (n, 3), tool frame, lie inside the convex hull."""
        if len(self.hull) == 0:
            return np.zeros(len(local), dtype=np.bool_)
        inside = local @ self.hull[:, :PLANE_OFFSET].T < self.hull[:, PLANE_OFFSET]
        return np.asarray(inside.all(axis=1), dtype=np.bool_)
