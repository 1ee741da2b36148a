"""All tools of an engine in one step, as arrays for the kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleError
from machine_sim.dem.tools.plane import PLANE_SIZE
from machine_sim.dem.tools.plates import Plates
from machine_sim.dem.tools.pose import (
    POSE_SIZE,
    TWIST_SIZE,
    interpolate_poses,
)
from machine_sim.dem.tools.rigid_tool import RigidTool
from msg_bridge.kernels import BoxedTable, box_table, fixed_signature_kernel, helper

__all__ = [
    "NO_TOOL",
    "SPHERE_CENTRE",
    "SPHERE_RADIUS",
    "SPHERE_SIZE",
    "ToolMotion",
    "ToolSet",
    "begin_tool_motion",
    "end_tool_motion",
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
    hull: NDArray[np.float64]
    first_plane: NDArray[np.int64]
    is_digging: NDArray[np.bool_]
    pushes_ground: NDArray[np.bool_]
    poses: NDArray[np.float64]
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
        pushes_ground: which of them the ground ahead fails before, shape (tools,), see
            `contacts.failing_ground`.
        sphere: bounding spheres, tool frame, shape (tools, 4), slots `SPHERE_CENTRE` and
            `SPHERE_RADIUS`.
        poses: packed poses at the start and at the end of a step, shape (2, tools, 12).
        path: packed poses before each substep and after the last, shape (substeps + 1, tools, 12).
        twist: packed twists in the step, shape (tools, 6).
        wrench: packed wrenches on the tools, shape (tools, 6). During a step their sum over the
            substeps, after it the mean.
        motion, boxed_motion: the arrays of a step that has begun, for kernels.
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
        return self.tools[self.index_of(tool_id)]

    def index_of(self, tool_id: int) -> int:
        """Return the index of a tool.

        Raises:
            ParticleError: no such tool.
        """
        index = self.index_by_id.get(tool_id)
        if index is None:
            raise ParticleError(f"there is no tool {tool_id}; add it with add_tool")
        return index

    def begin_step(self, dt: float) -> None:
        """Interpolate the poses of a step of `dt` [s], and clear the wrenches."""
        if not self.tools:
            return
        _begin_step(dt, self.boxed_motion)

    def end_step(self) -> None:
        """Leave the tools at their end poses until they are moved again."""
        _end_step(self.boxed_motion)

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
        self.pushes_ground = np.array([tool.pushes_ground for tool in self.tools], dtype=np.bool_)
        self.poses = np.zeros((2, count, POSE_SIZE))
        for t, tool in enumerate(self.tools):
            self.poses[:, t] = tool.records
            tool.records = self.poses[:, t]
        self.path = np.zeros((self.substeps + 1, count, POSE_SIZE))
        self.twist = np.zeros((count, TWIST_SIZE))
        self.wrench = np.zeros((count, TWIST_SIZE))
        self.motion = ToolMotion(
            self.plates, self.tool_of_plate, self.first_plate, self.sphere, self.hull,
            self.first_plane, self.is_digging, self.pushes_ground, self.poses, self.path,
            self.twist, self.wrench,
        )  # fmt: skip
        self.boxed_motion: BoxedTable = box_table(self.motion)


@fixed_signature_kernel
def _begin_step(dt, boxed_tools):  # type: ignore[no-untyped-def]
    begin_tool_motion(dt, boxed_tools.table)


@fixed_signature_kernel
def _end_step(boxed_tools):  # type: ignore[no-untyped-def]
    end_tool_motion(boxed_tools.table)


@helper(allocates=True)
def begin_tool_motion(dt, tools):  # type: ignore[no-untyped-def]
    """Interpolate the poses of a step of `dt` [s], and clear the wrenches, of a `ToolMotion`."""
    interpolate_poses(tools.poses[0], tools.poses[1], dt, tools.path, tools.twist)
    tools.wrench[:] = 0.0


@helper(allocates=True)
def end_tool_motion(tools):  # type: ignore[no-untyped-def]
    """Divide the wrenches by the number of substeps; the end poses become the start poses."""
    num_substeps = tools.path.shape[0] - 1
    for t in range(tools.twist.shape[0]):
        for k in range(TWIST_SIZE):
            tools.wrench[t, k] /= num_substeps
    tools.poses[0] = tools.poses[1]
