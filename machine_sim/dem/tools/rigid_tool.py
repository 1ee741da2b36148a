"""Rigid tools made of plates, moved by the machine; particles push back on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.state import ParticleError
from machine_sim.dem.tools.plates import Plates, convex_hull_planes
from machine_sim.dem.tools.pose import (
    Pose,
    interpolate_poses,
    pack_pose,
    rotation_cosine,
    to_tool_frame,
    validate_pose,
)
from msg_bridge.kernels import kernel

__all__ = ["RigidTool", "ToolMotion", "ToolSet"]


class RigidTool:
    """A tool of thin two-sided plates: a bucket, a blade, a cutter drum's envelope.

    Attributes:
        plates: its plates, tool frame.
        hull: half-spaces of the convex hull of its corners, shape (planes, 4).
        centre, reach: bounding sphere [m], tool frame.
        digs: whether it goes into the ground, see `ToolSet.classify_near_tools`.
        start, end: pose at the beginning and end of a step.
    """

    def __init__(
        self, polygons: Sequence[ArrayLike], pose: Pose, *, is_digging: bool = True
    ) -> None:
        """Build from plates, each (k, 3) corners [m] in the tool frame, in order around.

        Raises:
            ParticleError: no plate, or one that is not planar and convex.
        """
        if not polygons:
            raise ParticleError("a tool needs at least one plate")
        self.plates = Plates.from_polygons(polygons)
        corners = np.concatenate([np.asarray(p, dtype=np.float64) for p in polygons])
        self.hull = convex_hull_planes(corners)
        self.centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        self.bounding_radius = float(np.linalg.norm(corners - self.centre, axis=1).max())
        self.is_digging = is_digging
        self.start = self.end = validate_pose(pose)

    def move(self, start: Pose, end: Pose) -> None:
        """Set the motion of the next step.

        Raises:
            ParticleError: no poses, or a turn by 90 degrees or more; nothing was set.
        """
        start, end = validate_pose(start), validate_pose(end)
        if rotation_cosine(start[0], end[0]) <= 0.0:
            raise ParticleError("a tool turns by 90 deg or more in one step; use shorter steps")
        self.start, self.end = start, end

    def to_local_frame(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points [m] of the map frame, shape (n, 3), in the tool frame at the end pose."""
        return np.asarray((position - self.end[1]) @ self.end[0], dtype=np.float64)

    def contains(self, local: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which points [m], shape (n, 3), tool frame, lie inside the convex hull."""
        if len(self.hull) == 0:
            return np.zeros(len(local), dtype=np.bool_)
        inside = local @ self.hull[:, :3].T < self.hull[:, 3]
        return np.asarray(inside.all(axis=1), dtype=np.bool_)


class ToolMotion(NamedTuple):
    """All tools of an engine in one step, for kernels; see `ToolSet`."""

    plates: Plates
    tool_of_plate: NDArray[np.int64]
    path: NDArray[np.float64]
    twist: NDArray[np.float64]
    wrench: NDArray[np.float64]


class ToolSet:
    """All tools of an engine, their plates in one table for the kernels.

    Attributes:
        tools: in order of addition, which is their number in the arrays below.
        number: of each tool id.
        plates: of all tools one after another.
        owner: tool of each plate, shape (plates,), int64.
        first: first plate of each tool, and the end, shape (tools + 1,), int64.
        substeps: of a step.
        hull: hulls' half-spaces, all tools one after another, shape (planes, 4).
        first_hull: first of them of each tool, and the end, shape (tools + 1,), int64.
        digs: which tools dig, shape (tools,).
        sphere: bounding spheres, tool frame, x y z r [m], shape (tools, 4).
        path: poses before each substep and after the last, shape (substeps + 1, tools, 12).
        twist: velocity of the frame origin and angular velocity, map axes, shape (tools, 6).
        wrench: force [N] and torque about the frame origin [N m] on each tool, map axes, mean
            over the last step, shape (tools, 6).
    """

    def __init__(self, substeps: int) -> None:
        self.tools: list[RigidTool] = []
        self.index_by_id: dict[int, int] = {}
        self.substeps = substeps
        self._rebuild_arrays()

    def add(self, tool_id: int, tool: RigidTool) -> None:
        """Take a tool in, behind the others: plates keep their numbers.

        Raises:
            ParticleError: the id is taken.
        """
        if tool_id in self.index_by_id:
            raise ParticleError(f"there is a tool {tool_id} already; give each its own id")
        self.index_by_id[tool_id] = len(self.tools)
        self.tools.append(tool)
        self._rebuild_arrays()

    def remove(self, tool_id: int) -> int:
        """Take a tool out.

        Returns:
            The number it had; later ones move up.

        Raises:
            ParticleError: there is none.
        """
        self[tool_id]
        number = self.index_by_id.pop(tool_id)
        del self.tools[number]
        self.index_by_id = {key: k - (k > number) for key, k in self.index_by_id.items()}
        self._rebuild_arrays()
        return number

    def __getitem__(self, tool_id: int) -> RigidTool:
        """A tool by its id.

        Raises:
            ParticleError: there is none.
        """
        if tool_id not in self.index_by_id:
            raise ParticleError(f"there is no tool {tool_id}; add it with add_tool")
        return self.tools[self.index_by_id[tool_id]]

    def begin_step(self, dt: float) -> None:
        """Lay out the poses of a step of `dt` [s]."""
        if not self.tools:
            return
        for t, tool in enumerate(self.tools):
            pack_pose(tool.start, self._start[t])
            pack_pose(tool.end, self._end[t])
        interpolate_poses(self._start, self._end, dt, self.path, self.twist)
        self.wrench[:] = 0.0

    @property
    def motion(self) -> ToolMotion:
        """What kernels are given of a step that has begun."""
        return ToolMotion(self.plates, self.tool_of_plate, self.path, self.twist, self.wrench)

    def tool_frame_positions(
        self, rows: NDArray[np.int64], position: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Places of some particles at the start of the step, seen from each tool.

        Args:
            rows: of the particles.
            position: of all [m], map frame, shape (n, 3).

        Returns:
            [m], tool frames, shape (tools, 3, rows).
        """
        tool_frame_positions = np.empty((len(self.tools), 3, rows.size))
        _to_tool_frames(rows, position, self.path[0], tool_frame_positions)
        return tool_frame_positions

    def classify_near_tools(
        self, tool_frame_positions: NDArray[np.float64], margin: float
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_]]:
        """Which tool holds each of some particles, and what that means for the ground under it.

        What a digging tool holds, its plates keep the terrain from: a bucket half in the ground
        lies below the surface of the columns it stands in. A box that stands on the ground or over
        it does not.

        Args:
            places: theirs, see `places`.
            margin: distance from a digging tool's bounding sphere that still is near [m].

        Returns:
            (inside, lifted, near), shape (rows,) each: number of the tool in whose hull it is, -1
            for none; whether that one digs; and whether it is near one that does.
        """
        inside = np.full(tool_frame_positions.shape[2], -1, dtype=np.int64)
        ground_masked, near = np.zeros(inside.size, np.bool_), np.zeros(inside.size, np.bool_)
        _classify(
            tool_frame_positions,
            self.sphere,
            self.hull,
            self.first_hull,
            self.is_digging,
            margin,
            inside,
            ground_masked,
            near,
        )
        return inside, ground_masked, near

    def end_step(self) -> None:
        """Rest at the end pose until moved again."""
        self.wrench /= self.substeps
        for tool in self.tools:
            tool.start = tool.end

    def _rebuild_arrays(self) -> None:
        count = len(self.tools)
        sizes = [len(tool.plates.num_corners) for tool in self.tools]
        self.plates = Plates.concatenate([tool.plates for tool in self.tools])
        self.tool_of_plate = np.repeat(
            np.arange(count, dtype=np.int64), np.asarray(sizes, dtype=np.int64)
        )
        self.first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self.sphere = np.array([[*t.centre, t.bounding_radius] for t in self.tools]).reshape(
            count, 4
        )
        hulls = [tool.hull for tool in self.tools]
        self.hull = np.concatenate([np.zeros((0, 4)), *hulls])
        self.first_hull = np.concatenate([[0], np.cumsum([len(h) for h in hulls])]).astype(np.int64)
        self.is_digging = np.array([tool.is_digging for tool in self.tools], dtype=np.bool_)
        self._start, self._end = np.zeros((count, 12)), np.zeros((count, 12))
        self.path = np.zeros((self.substeps + 1, count, 12))
        self.twist = np.zeros((count, 6))
        self.wrench = np.zeros((count, 6))


@kernel
def _to_tool_frames(rows, position, pose, tool_frame_positions):  # type: ignore[no-untyped-def]
    """See `ToolSet.places`."""
    for t in range(pose.shape[0]):
        p = pose[t]
        for n in range(rows.size):
            i = rows[n]
            (
                tool_frame_positions[t, 0, n],
                tool_frame_positions[t, 1, n],
                tool_frame_positions[t, 2, n],
            ) = to_tool_frame(p, position[i, 0], position[i, 1], position[i, 2])


@kernel
def _classify(  # type: ignore[no-untyped-def]
    tool_frame_positions, sphere, hull, first, is_digging, margin, inside, ground_masked, near
):
    """See `ToolSet.classify_near_tools`; plane by plane, so that many particles are looked at together."""
    inside_hull = np.empty(inside.size, np.bool_)
    for t in range(sphere.shape[0]):
        around = _mark_within_sphere(tool_frame_positions[t], sphere[t], margin, inside_hull)
        if around == 0:
            continue
        if is_digging[t]:
            near |= inside_hull
        if first[t + 1] == first[t]:
            continue
        for h in range(first[t], first[t + 1]):
            _exclude_beyond_plane(
                tool_frame_positions[t], hull[h, 0], hull[h, 1], hull[h, 2], hull[h, 3], inside_hull
            )
        for n in range(inside.size):
            if inside_hull[n] and inside[n] < 0:
                inside[n], ground_masked[n] = t, is_digging[t]


@kernel
def _mark_within_sphere(tool_frame_positions, sphere, margin, within):  # type: ignore[no-untyped-def]
    """Mark who is within a bounding sphere and some margin; returns how many are."""
    count, far = 0, (sphere[3] + margin) ** 2
    for n in range(np.uint64(within.size)):
        x, y, z = (
            tool_frame_positions[0, n] - sphere[0],
            tool_frame_positions[1, n] - sphere[1],
            tool_frame_positions[2, n] - sphere[2],
        )
        within[n] = x * x + y * y + z * z <= far
        count += within[n]
    return count


@kernel
def _exclude_beyond_plane(tool_frame_positions, nx, ny, nz, height, inside_hull):  # type: ignore[no-untyped-def]
    """Unmark who is beyond a plane."""
    for n in range(np.uint64(inside_hull.size)):
        inside_hull[n] &= (
            nx * tool_frame_positions[0, n]
            + ny * tool_frame_positions[1, n]
            + nz * tool_frame_positions[2, n]
            < height
        )
