"""Apparent gravity in each tool: gravity minus the acceleration of the tool, in tool axes.

Soil at rest in a tool stays at rest while the apparent gravity stays near the value under which it
came to rest. Tilting and shaking the tool change it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.tools.pose import XX, YX, ZX, rotate_to_map_axes, velocity_at
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.dem.tools.tool_set import SPHERE_CENTRE
from machine_sim.dem.vec3 import dot, load_row, subtract
from msg_bridge.kernels import BoxedTable, box_table, helper

__all__ = ["ApparentGravity", "GravityInTools", "has_changed", "update_gravity"]

_FILTER_TIME = 0.06
"""Time constant of the low-pass filter on a tool's acceleration [s]: jerks of a drive are not
shaking."""


class GravityInTools(NamedTuple):
    """Apparent gravity of each tool, for kernels; one row per tool, shape (tools, 3).

    Attributes:
        current: apparent gravity at the centre of the tool [m/s^2], tool axes.
        at_lock: the same when soil was locked to the tool last.
        acceleration: filtered acceleration of the centre [m/s^2], map axes.
        velocity: velocity of the centre in the step before [m/s], map axes.
    """

    current: NDArray[np.float64]
    at_lock: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    velocity: NDArray[np.float64]


class ApparentGravity:
    """Filtered acceleration and apparent gravity of each tool, in the order of the tool indices.

    Attributes:
        standard: acceleration of gravity, downward [m/s^2].
        in_tools, boxed: `GravityInTools`; kernels update it.
    """

    def __init__(self, gravity: float) -> None:
        self.standard = gravity
        self._set_rows(np.zeros((0, 3)) for _ in GravityInTools._fields)

    def _set_rows(self, columns: Iterable[NDArray[np.float64]]) -> None:
        self.in_tools = GravityInTools(*columns)
        self.boxed: BoxedTable = box_table(self.in_tools)

    def add_tool(self, tool: RigidTool) -> None:
        """Append a tool that has been at rest at its pose so far."""
        current, at_rest = tool.start[0].T @ np.array([0.0, 0.0, -self.standard]), np.zeros(3)
        added = GravityInTools(current, current, acceleration=at_rest, velocity=at_rest)
        self._set_rows(map(np.vstack, zip(self.in_tools, added, strict=True)))

    def remove_tool(self, index: int) -> None:
        """Remove a tool; the indices of later ones decrease by one."""
        self._set_rows(np.delete(column, index, axis=0) for column in self.in_tools)


@helper
def has_changed(gravity, tool, threshold):  # type: ignore[no-untyped-def]
    """Return whether the apparent gravity in a tool differs from that at locking.

    Args:
        gravity: `GravityInTools`.
        tool: index of the tool.
        threshold: minimum difference [m/s^2].
    """
    change = subtract(load_row(gravity.current, tool, 0), load_row(gravity.at_lock, tool, 0))
    return np.sqrt(dot(change, change)) > threshold


@helper
def update_gravity(tools, standard, dt, gravity):  # type: ignore[no-untyped-def]
    """Filter the acceleration of each tool's centre, and rotate apparent gravity to tool axes.

    Args:
        tools: `ToolMotion` of a step that has begun.
        standard: acceleration of gravity, downward [m/s^2].
        dt: length of the step [s].
        gravity: `GravityInTools`, updated.
    """
    pose, twist, sphere = tools.path[0], tools.twist, tools.sphere
    velocity, acceleration, current = gravity.velocity, gravity.acceleration, gravity.current
    weight = dt / (_FILTER_TIME + dt)
    for t in range(pose.shape[0]):
        x, y, z = rotate_to_map_axes(
            pose[t],
            sphere[t, SPHERE_CENTRE],
            sphere[t, SPHERE_CENTRE + 1],
            sphere[t, SPHERE_CENTRE + 2],
        )
        new_velocity = velocity_at(twist[t], x, y, z)
        for axis in range(3):
            new_acceleration = (new_velocity[axis] - velocity[t, axis]) / dt
            acceleration[t, axis] += weight * (new_acceleration - acceleration[t, axis])
            velocity[t, axis] = new_velocity[axis]
        down = -standard - acceleration[t, 2]
        for axis in range(3):
            current[t, axis] = (
                pose[t, ZX + axis] * down
                - pose[t, XX + axis] * acceleration[t, 0]
                - pose[t, YX + axis] * acceleration[t, 1]
            )
