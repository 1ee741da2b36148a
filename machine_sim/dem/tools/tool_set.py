"""All tools of an engine in one step, as arrays for the kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleError
from machine_sim.dem.tools.plane import PLANE_NORMAL, PLANE_OFFSET, PLANE_SIZE
from machine_sim.dem.tools.plates import Plates
from machine_sim.dem.tools.pose import (
    POSE_SIZE,
    TWIST_SIZE,
    interpolate_poses,
    pack_pose,
    to_tool_frame,
)
from machine_sim.dem.tools.rigid_tool import RigidTool
from msg_bridge.kernels import helper, kernel

__all__ = [
    "NO_TOOL",
    "SPHERE_CENTRE",
    "SPHERE_RADIUS",
    "SPHERE_SIZE",
    "ToolMotion",
    "ToolSet",
]

NO_TOOL = -1
"""Tool index of a particle that is in no tool."""

SPHERE_CENTRE = 0
"""First of three slots of the centre [m] in a packed sphere."""
SPHERE_RADIUS = 3
"""Slot of the radius [m] in a packed sphere."""
SPHERE_SIZE = 4
"""Numbers in a packed sphere."""


class ToolMotion(NamedTuple):
    """All tools of an engine in one step, for kernels; the attributes are those of `ToolSet`."""

    plates: Plates
    tool_of_plate: NDArray[np.int64]
    first_plate: NDArray[np.int64]
    sphere: NDArray[np.float64]
    path: NDArray[np.float64]
    twist: NDArray[np.float64]
    wrench: NDArray[np.float64]


class ToolSet:
    """All tools of an engine, their plates in one table.

    Attributes:
        tools: tools in order of addition, which is their index in the arrays below.
        index_by_id: index of each tool id.
        plates: plates of all tools, tool by tool.
        tool_of_plate: tool index of each plate, shape (plates,), int64.
        first_plate: first plate of each tool, and the end, shape (tools + 1,), int64.
        substeps: number of substeps of a step.
        hull: half-spaces of the convex hulls, tool by tool, shape (planes, 4), see `tools.plane`.
        first_plane: first half-space of each tool, and the end, shape (tools + 1,), int64.
        is_digging: which tools enter the ground, shape (tools,).
        sphere: bounding spheres, tool frame, shape (tools, 4), slots `SPHERE_CENTRE` and
            `SPHERE_RADIUS`.
        path: packed poses before each substep and after the last, shape (substeps + 1, tools, 12).
        twist: packed twists in the step, shape (tools, 6).
        wrench: packed wrenches on the tools, shape (tools, 6). During a step their sum over the
            substeps, after it the mean.
        motion: the arrays of a step that has begun, for kernels.
    """

    def __init__(self, substeps: int) -> None:
        self.tools: list[RigidTool] = []
        self.index_by_id: dict[int, int] = {}
        self.substeps = substeps
        self._rebuild_arrays()

    def add(self, tool_id: int, tool: RigidTool) -> None:
        """Append a tool; the indices of present plates do not change.

        Raises:
            ParticleError: the id is in use.
        """
        if tool_id in self.index_by_id:
            raise ParticleError(f"tool {tool_id} exists already; give each tool its own id")
        self.index_by_id[tool_id] = len(self.tools)
        self.tools.append(tool)
        self._rebuild_arrays()

    def remove(self, tool_id: int) -> int:
        """Remove a tool; the indices of later ones decrease by one.

        Returns:
            The index that the tool had.

        Raises:
            ParticleError: no such tool.
        """
        self[tool_id]
        index = self.index_by_id.pop(tool_id)
        del self.tools[index]
        self.index_by_id = {key: k - (k > index) for key, k in self.index_by_id.items()}
        self._rebuild_arrays()
        return index

    def __getitem__(self, tool_id: int) -> RigidTool:
        """Return a tool by its id.

        Raises:
            ParticleError: no such tool.
        """
        if tool_id not in self.index_by_id:
            raise ParticleError(f"there is no tool {tool_id}; add it with add_tool")
        return self.tools[self.index_by_id[tool_id]]

    def begin_step(self, dt: float) -> None:
        """Interpolate the poses of a step of `dt` [s], and clear the wrenches."""
        if not self.tools:
            return
        for t, tool in enumerate(self.tools):
            pack_pose(tool.start, self._start[t])
            pack_pose(tool.end, self._end[t])
        interpolate_poses(self._start, self._end, dt, self.path, self.twist)
        self.wrench[:] = 0.0

    def tool_frame_positions(
        self, rows: NDArray[np.int64], position: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Transform the positions of some particles to each tool's frame at the step's start.

        Args:
            rows: the particles.
            position: centres of all particles [m], map frame, shape (n, 3).

        Returns:
            Positions [m], tool frames, shape (tools, 3, rows).
        """
        positions = np.empty((len(self.tools), 3, rows.size))
        _to_tool_frames(rows, position, self.path[0], positions)
        return positions

    def classify_near_tools(
        self, tool_frame_positions: NDArray[np.float64], margin: float
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_]]:
        """Find the tool that each of some particles is in, and what it means for ground contact.

        The plates of a digging tool keep the terrain away from what is in the tool: a bucket half
        in the ground is below the surface of the columns it stands in. A box that stands on or
        over the ground does not.

        Args:
            tool_frame_positions: their positions, see the method of that name.
            margin: distance from the bounding sphere of a digging tool that counts as near [m].

        Returns:
            (inside, ground_masked, near), shape (rows,) each: index of the tool in whose hull the
            particle is, `NO_TOOL` for none; whether that tool digs; and whether the particle is
            near a tool that digs.
        """
        inside = np.full(tool_frame_positions.shape[2], NO_TOOL, dtype=np.int64)
        ground_masked, near = np.zeros(inside.size, np.bool_), np.zeros(inside.size, np.bool_)
        _classify(
            tool_frame_positions,
            self.sphere,
            self.hull,
            self.first_plane,
            self.is_digging,
            margin,
            inside,
            ground_masked,
            near,
        )
        return inside, ground_masked, near

    def end_step(self) -> None:
        """Leave the tools at their end poses until they are moved again."""
        self.wrench /= self.substeps
        for tool in self.tools:
            tool.start = tool.end

    def _rebuild_arrays(self) -> None:
        count = len(self.tools)
        self.plates = Plates.concatenate([tool.plates for tool in self.tools])
        num_plates = np.array([len(tool.plates.num_corners) for tool in self.tools], np.int64)
        self.tool_of_plate = np.repeat(np.arange(count, dtype=np.int64), num_plates)
        self.first_plate = np.concatenate([[0], np.cumsum(num_plates)]).astype(np.int64)
        spheres = [[*tool.centre, tool.bounding_radius] for tool in self.tools]
        self.sphere = np.array(spheres).reshape(count, SPHERE_SIZE)
        hulls = [tool.hull for tool in self.tools]
        self.hull = np.concatenate([np.zeros((0, PLANE_SIZE)), *hulls])
        num_planes = [len(hull) for hull in hulls]
        self.first_plane = np.concatenate([[0], np.cumsum(num_planes)]).astype(np.int64)
        self.is_digging = np.array([tool.is_digging for tool in self.tools], dtype=np.bool_)
        self._start, self._end = np.zeros((count, POSE_SIZE)), np.zeros((count, POSE_SIZE))
        self.path = np.zeros((self.substeps + 1, count, POSE_SIZE))
        self.twist = np.zeros((count, TWIST_SIZE))
        self.wrench = np.zeros((count, TWIST_SIZE))
        self.motion = ToolMotion(
            self.plates, self.tool_of_plate, self.first_plate, self.sphere, self.path, self.twist,
            self.wrench,
        )  # fmt: skip


@kernel
def _to_tool_frames(rows, position, pose, tool_frame_positions):  # type: ignore[no-untyped-def]
    """Fill the positions in the frame of each packed pose, see `ToolSet.tool_frame_positions`."""
    for t in range(pose.shape[0]):
        p = pose[t]
        for n in range(rows.size):
            i = rows[n]
            x, y, z = to_tool_frame(p, position[i, 0], position[i, 1], position[i, 2])
            tool_frame_positions[t, 0, n] = x
            tool_frame_positions[t, 1, n] = y
            tool_frame_positions[t, 2, n] = z


@kernel
def _classify(  # type: ignore[no-untyped-def]
    tool_frame_positions, sphere, hull, first_plane, is_digging, margin, inside, ground_masked, near
):
    """Fill the results of `ToolSet.classify_near_tools`; plane by plane, so that it vectorises."""
    within = np.empty(inside.size, np.bool_)
    for t in range(sphere.shape[0]):
        num_within = _mark_within_sphere(tool_frame_positions[t], sphere[t], margin, within)
        if num_within == 0:
            continue
        if is_digging[t]:
            near |= within
        if first_plane[t + 1] == first_plane[t]:
            continue
        for h in range(first_plane[t], first_plane[t + 1]):
            _exclude_beyond_plane(
                tool_frame_positions[t],
                hull[h, PLANE_NORMAL],
                hull[h, PLANE_NORMAL + 1],
                hull[h, PLANE_NORMAL + 2],
                hull[h, PLANE_OFFSET],
                within,
            )
        for n in range(inside.size):
            if within[n] and inside[n] == NO_TOOL:
                inside[n], ground_masked[n] = t, is_digging[t]


@helper(forceinline=True)
def _mark_within_sphere(positions, sphere, margin, within):  # type: ignore[no-untyped-def]
    """Mark the positions within a margin [m] of a bounding sphere, and return their number."""
    count, max_distance2 = 0, (sphere[SPHERE_RADIUS] + margin) ** 2
    for n in range(np.uint64(within.size)):
        x = positions[0, n] - sphere[SPHERE_CENTRE]
        y = positions[1, n] - sphere[SPHERE_CENTRE + 1]
        z = positions[2, n] - sphere[SPHERE_CENTRE + 2]
        within[n] = x * x + y * y + z * z <= max_distance2
        count += within[n]
    return count


@helper(forceinline=True)
def _exclude_beyond_plane(positions, nx, ny, nz, offset, within):  # type: ignore[no-untyped-def]
    """Clear the mark of each position beyond a plane."""
    for n in range(np.uint64(within.size)):
        within[n] &= nx * positions[0, n] + ny * positions[1, n] + nz * positions[2, n] < offset
