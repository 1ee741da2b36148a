"""Which cubes are in a tool, which beside one, and how the tool moves there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.tools.rigid_tool import ToolSet

__all__ = ["ToolProximity", "find_tool_proximity"]


@dataclass(frozen=True)
class ToolProximity:
    """The tools as cubes see them; arrays have one row per cube.

    Attributes:
        inside: in the convex hull of a tool.
        beside: in reach of a tool's bounding sphere, or inside one.
        velocity: of the tool there [m/s], map frame; zero away from tools.
        held: inside a tool that digs: its plates keep the terrain away.
        near: beside a tool that digs, where the surface is known only roughly.
    """

    inside: NDArray[np.bool_]
    in_reach: NDArray[np.bool_]
    velocity: NDArray[np.float64]
    shielded: NDArray[np.bool_]
    near_digging_tool: NDArray[np.bool_]


def find_tool_proximity(
    tools: ToolSet, position: NDArray[np.float64], size: NDArray[np.float32], cell: float
) -> ToolProximity:
    """Look from every cube to the tools at the start of a step.

    Args:
        tools: with the motion of the step laid out.
        position: centres [m], map frame, shape (n, 3).
        size: edges [m], shape (n,).
        cell: width of a column of the terrain [m].
    """
    n = len(position)
    inside, in_reach, shielded, near_digging_tool = np.zeros((4, n), np.bool_)
    around = ToolProximity(inside, in_reach, np.zeros((n, 3)), shielded, near_digging_tool)
    for tool, twist in zip(tools.tools, tools.twist, strict=True):
        rotation, origin = tool.start
        offset = position - origin
        distance = np.linalg.norm(offset - rotation @ tool.centre, axis=1)
        within = tool.contains(offset @ rotation)
        reached = within | (distance <= tool.bounding_radius + size)
        # Of several tools the one that holds the cube counts, else the last in reach.
        counts = within | (reached & ~inside)
        around.velocity[counts] = twist[:3] + np.cross(twist[3:], offset[counts])
        inside |= within
        in_reach |= reached
        if tool.is_digging:
            shielded |= within
            near_digging_tool |= distance <= tool.bounding_radius + cell
    return around
