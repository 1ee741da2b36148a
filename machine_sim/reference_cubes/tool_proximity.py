"""Proximity of cubes to tools: which cube is in or near which tool, and the tool's motion there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.tools.pose import ANGULAR
from machine_sim.dem.tools.tool_set import ToolSet

__all__ = ["ToolProximity", "find_tool_proximity"]


@dataclass(frozen=True)
class ToolProximity:
    """Relation of each cube to the tools; arrays have one row per cube.

    Attributes:
        inside: whether it is in the convex hull of a tool.
        in_reach: whether it is inside a tool or touches the bounding sphere of one.
        velocity: velocity of that tool at the cube [m/s], map frame; zero out of reach.
        ground_masked: whether it is inside a tool that digs, which keeps the terrain away.
        near_digging_tool: whether it is near a tool that digs, where the surface is imprecise.
    """

    inside: NDArray[np.bool_]
    in_reach: NDArray[np.bool_]
    velocity: NDArray[np.float64]
    ground_masked: NDArray[np.bool_]
    near_digging_tool: NDArray[np.bool_]


def find_tool_proximity(
    tools: ToolSet, position: NDArray[np.float64], size: NDArray[np.float32], cell: float
) -> ToolProximity:
    """Return the relation of each cube to the tools at the start of a step.

    Args:
        tools: tools that have begun the step.
        position: centres [m], map frame, shape (n, 3).
        size: edge lengths [m], shape (n,).
        cell: width of a column of the terrain [m].
    """
    n = len(position)
    inside, in_reach, ground_masked, near_digging_tool = np.zeros((4, n), np.bool_)
    velocity = np.zeros((n, 3))
    for tool, twist in zip(tools.tools, tools.twist, strict=True):
        rotation, origin = tool.start
        offset = position - origin
        distance = np.linalg.norm(offset - rotation @ tool.centre, axis=1)
        in_hull = tool.contains(offset @ rotation)
        reached = in_hull | (distance <= tool.bounding_radius + size)
        # The tool that contains the cube takes precedence over the last one in reach.
        takes_velocity = in_hull | (reached & ~inside)
        rotational = np.cross(twist[ANGULAR:], offset[takes_velocity])
        velocity[takes_velocity] = twist[:ANGULAR] + rotational
        inside |= in_hull
        in_reach |= reached
        if tool.is_digging:
            ground_masked |= in_hull
            near_digging_tool |= distance <= tool.bounding_radius + cell
    return ToolProximity(inside, in_reach, velocity, ground_masked, near_digging_tool)
