"""What an engine keeps for the sleep of its particles from step to step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.sleep.apparent_gravity import ApparentGravity
from machine_sim.dem.sleep.sleep_state import locked_tool
from machine_sim.dem.sleep.wake_conditions import WAKE_SPHERE_SIZE
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.dem.tools.tool_set import ToolSet
from msg_bridge.kernels import BoxedTable

__all__ = ["SleepManager"]

_NO_SPHERES = np.zeros((0, WAKE_SPHERE_SIZE))


class SleepManager:
    """Gravity in the tools, and the places where particles wake before the next step."""

    def __init__(self, gravity: float) -> None:
        """
        Args:
            gravity: acceleration of gravity, downward [m/s^2].
        """
        self._wake_spheres: list[NDArray[np.float64]] = []
        self._gravity = ApparentGravity(gravity)

    @property
    def boxed_gravity(self) -> BoxedTable:
        """`GravityInTools`, boxed; the kernel of a step updates it."""
        return self._gravity.boxed

    def add_tool(self, tool: RigidTool) -> None:
        """Append a tool that has been at rest at its pose so far."""
        self._gravity.add_tool(tool)

    def remove_tool(self, index: int) -> None:
        """Remove a tool; later indices decrease by one. The caller wakes all locked particles."""
        self._gravity.remove_tool(index)

    def request_wake(self, spheres: NDArray[np.float64]) -> None:
        """Wake the particles that reach into spheres before the next step.

        Args:
            spheres: centre and radius [m], map frame, shape (n, WAKE_SPHERE_SIZE).
        """
        if len(spheres):
            self._wake_spheres.append(spheres)

    def pop_wake_spheres(self) -> NDArray[np.float64]:
        """Return the spheres of `request_wake` since the last call, shape (n, WAKE_SPHERE_SIZE)."""
        if not self._wake_spheres:
            return _NO_SPHERES
        spheres = np.concatenate(self._wake_spheres)
        self._wake_spheres.clear()
        return spheres

    @staticmethod
    def set_locked_positions(state: ParticleState, tools: ToolSet, rows: NDArray[np.int64]) -> None:
        """Set the wake references of `rows` that are locked to a tool: positions in its frame."""
        tool_of_row = locked_tool(state.sleep_state[rows])
        for t in np.unique(tool_of_row[tool_of_row >= 0]):
            locked_rows = rows[tool_of_row == t]
            rotation, origin = tools.tools[t].end
            state.wake_reference[locked_rows] = (state.position[locked_rows] - origin) @ rotation
