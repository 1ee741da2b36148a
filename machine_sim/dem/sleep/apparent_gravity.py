"""Apparent gravity in each tool: gravity minus the acceleration of the tool, in tool axes.

Soil at rest in a tool stays at rest while the apparent gravity stays near the value under which it
came to rest. Tilting and shaking the tool change it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.tools.pose import XX, YX, ZX, rotate_to_map_axes, velocity_at
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.dem.tools.tool_set import SPHERE_CENTRE, ToolSet
from machine_sim.dem.vec3 import dot, load_row, subtract
from msg_bridge.kernels import kernel

__all__ = ["ApparentGravity"]

_FILTER_TIME = 0.06
"""Time constant of the low-pass filter on a tool's acceleration [s]: jerks of a drive are not
shaking."""


class ApparentGravity:
    """Filtered acceleration and apparent gravity of each tool, in the order of the tool indices.

    Attributes:
        gravity_vector: gravity [m/s^2], map axes, shape (3,).
        current: apparent gravity at the centre of each tool [m/s^2], tool axes, shape (tools, 3).
        at_lock: the same when soil was locked to the tool last, shape (tools, 3).
        acceleration: filtered acceleration of the centre [m/s^2], map axes, shape (tools, 3).
    """

    def __init__(self, gravity: float) -> None:
        self._gravity = gravity
        self.gravity_vector = np.array([0.0, 0.0, -gravity])
        self.current = np.zeros((0, 3))
        self.at_lock = np.zeros((0, 3))
        self.acceleration = np.zeros((0, 3))
        self._velocity = np.zeros((0, 3))

    def add_tool(self, tool: RigidTool) -> None:
        """Append a tool that has been at rest at its pose so far."""
        current = tool.start[0].T @ self.gravity_vector
        self.current = np.vstack([self.current, current])
        self.at_lock = np.vstack([self.at_lock, current])
        self.acceleration = np.vstack([self.acceleration, np.zeros(3)])
        self._velocity = np.vstack([self._velocity, np.zeros(3)])

    def remove_tool(self, index: int) -> None:
        """Remove a tool; the indices of later ones decrease by one."""
        self.current = np.delete(self.current, index, axis=0)
        self.at_lock = np.delete(self.at_lock, index, axis=0)
        self.acceleration = np.delete(self.acceleration, index, axis=0)
        self._velocity = np.delete(self._velocity, index, axis=0)

    def update(self, tools: ToolSet, dt: float) -> None:
        """Take over the motion of a step of `dt` [s] that `tools` have begun."""
        if tools.tools:
            _update(
                tools.path[0], tools.twist, tools.sphere, self._gravity, dt, self._velocity,
                self.acceleration, self.current,
            )  # fmt: skip

    def set_lock(self, index: int) -> None:
        """Store the current value of a tool as the one under which its load was locked."""
        self.at_lock[index] = self.current[index]

    def changed_by(self, threshold: float) -> NDArray[np.bool_]:
        """Return for which tools it has changed by more than `threshold` [m/s^2] since locking."""
        changed = np.zeros(len(self.current), np.bool_)
        _mark_changed(self.current, self.at_lock, threshold, changed)
        return changed


@kernel
def _mark_changed(current, at_lock, threshold, changed):  # type: ignore[no-untyped-def]
    """Mark the tools whose apparent gravity differs from that at locking by more than a threshold.

    Args:
        current, at_lock: [m/s^2], shape (tools, 3).
        threshold: [m/s^2].
        changed: out, shape (tools,).
    """
    for t in range(changed.size):
        change = subtract(load_row(current, t, 0), load_row(at_lock, t, 0))
        changed[t] = np.sqrt(dot(change, change)) > threshold


@kernel
def _update(pose, twist, sphere, gravity, dt, velocity, acceleration, apparent_gravity):  # type: ignore[no-untyped-def]
    """Filter the acceleration of each tool's centre, and rotate apparent gravity to tool axes.

    Args:
        pose, twist, sphere: packed, of each tool, see `tools.pose` and `ToolSet`.
        gravity: [m/s^2], downward.
        dt: [s].
        velocity, acceleration, apparent_gravity: shape (tools, 3), updated.
    """
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
        down = -gravity - acceleration[t, 2]
        for axis in range(3):
            apparent_gravity[t, axis] = (
                pose[t, ZX + axis] * down
                - pose[t, XX + axis] * acceleration[t, 0]
                - pose[t, YX + axis] * acceleration[t, 1]
            )
